// axe-core on every page: light, dark, wide and narrow; no violation of any level, contrast of 7 to 1 included.

import AxeBuilder from "@axe-core/playwright";
import { type Page } from "@playwright/test";
import { ask } from "./api";
import {
  drawn,
  drop,
  expect,
  joinedMap,
  laterMap,
  open,
  openMap,
  otherMap,
  recording,
  roomMap,
  service,
  submit,
  test,
} from "./fixtures";
import { carmen, room } from "./room";

const RULES = { "color-contrast-enhanced": { enabled: true }, "target-size": { enabled: true } };

/** Judges what is shown in each theme and width. */
async function judge(page: Page): Promise<void> {
  for (const width of [1280, 390]) {
    await page.setViewportSize({ width, height: 800 });
    for (const colorScheme of ["light", "dark"] as const) {
      await page.emulateMedia({ colorScheme });
      const { violations } = await new AxeBuilder({ page }).options({ rules: RULES }).analyze();
      const found = violations.map(
        ({ id, impact, nodes }) =>
          `${id} (${impact}): ${nodes.map((node) => `${node.target} ${node.failureSummary}`).join("; ")}`,
      );
      expect(found, `${colorScheme}, ${width} pixels`).toEqual([]);
    }
    const wider = await page.evaluate(
      () => document.documentElement.scrollWidth - document.documentElement.clientWidth,
    );
    expect(wider, `the page scrolls sideways at ${width} pixels`).toBeLessThanOrEqual(0);
  }
}

test("every page is accessible", async ({ page }) => {
  await ask(service(), "PUT", "/v1/places/seen", { map_id: roomMap(), note: "first" });
  await ask(service(), "PUT", "/v1/places/seen", { map_id: otherMap() });
  await open(page, "#/jobs");
  for (const address of [
    "jobs",
    "jobs?status=failed&label=a:b",
    "maps",
    "submit",
    "places",
    "places/seen",
    "key",
    "nowhere",
    "maps/none",
    "jobs/none",
  ]) {
    await page.goto(`/#/${address}`);
    await expect(page.locator("main [aria-busy], main [role=status]:text('Loading')")).toHaveCount(0);
    await judge(page);
  }
  await ask(service(), "DELETE", "/v1/places/seen");
});

test("a map with everything on it is accessible", async ({ page }) => {
  await openMap(page, `?show=contour,returns,poses&at=2,2&ruler=1,1,3,3&compare=${otherMap()}`);
  await expect(page.locator(".answer").first()).toContainText("Distance");
  await page.locator(".downloads summary").first().click();
  await drop(page, "walk.log", carmen());
  await expect(page.getByText(/scans located/)).toBeVisible();
  await judge(page);
});

for (const [what, id] of [
  ["joined", joinedMap],
  ["later", laterMap],
] as const) {
  test(`a ${what} map is accessible`, async ({ page }) => {
    await openMap(page, `?show=contour,changes,frames&layer=sigma&compare=${roomMap()}`, id());
    await expect(page.getByRole("heading", { name: "Lineage" })).toBeVisible();
    await drawn(page);
    await judge(page);
  });
}

test("a job and a question are accessible", async ({ page }) => {
  const id = await submit(room({ name: "asked", scans: 160, beams: 720, resolution: 0.04 }));
  await open(page, `#/jobs/${id}`);
  await expect(page.locator(".chip")).toHaveText(/running|waiting/);
  await judge(page);
  await page.getByRole("button", { name: /Cancel/ }).click();
  await judge(page);
  await page.getByRole("button", { name: "Cancel the job" }).click();
  await expect(page.locator(".chip")).toHaveText("cancelled");
  await judge(page);
});

test("a job that failed, one that succeeded, and one whose connection is lost are accessible", async ({ page }) => {
  const long = room({ name: "long", scans: 160, beams: 720, resolution: 0.04 });
  const late = await submit({ ...long, name: "late", deadline_seconds: 0.5 });
  await open(page, `#/jobs/${late}`);
  await expect(page.getByRole("alert")).toContainText(/deadline/i);
  await judge(page);
  const { job_id } = await ask<{ job_id: string }>(service(), "GET", `/v1/maps/${roomMap()}`);
  await open(page, `#/jobs/${job_id}`);
  await expect(page.getByRole("link", { name: /Open map/ })).toBeVisible();
  await judge(page);
  const lost = await submit(long);
  await page.route("**/events", (route) => route.abort());
  await open(page, `#/jobs/${lost}`);
  await expect(page.getByText("The connection is lost")).toBeVisible();
  await judge(page);
  await ask(service(), "DELETE", `/v1/jobs/${lost}`);
});

test("what is asked before a place is rolled back or deleted, and a refused publication, are accessible", async ({
  page,
}) => {
  await ask(service(), "PUT", "/v1/places/asked", { map_id: roomMap() });
  await ask(service(), "PUT", "/v1/places/asked", { map_id: otherMap() });
  await open(page, "#/places/asked");
  for (const button of ["Roll back to version 1", "Delete the place"]) {
    await page.getByRole("button", { name: button }).click();
    await expect(page.getByRole("dialog")).toBeVisible();
    await judge(page);
    await page.keyboard.press("Escape");
  }
  await open(page, "#/places");
  await page.getByLabel("Name").fill("asked");
  await page.getByRole("button", { name: "Publish" }).click();
  await expect(page.getByRole("alert")).toBeVisible();
  await judge(page);
  await ask(service(), "DELETE", "/v1/places/asked");
});

test("a recording before it is sent is accessible", async ({ page }) => {
  await open(page, "#/submit");
  await drop(page, "drive.mcap", recording("drive-zstd.mcap"));
  await expect(page.locator(".forecast")).toContainText("476 control points");
  await judge(page);
});

test("a submission is accessible", async ({ page }) => {
  await open(page, "#/submit");
  await drop(page, "walk.log", carmen());
  await expect(page.locator(".forecast")).toContainText("control points");
  await page.getByText("More", { exact: true }).click();
  await page.getByLabel("Resolution, m").fill("0.0004");
  await page.getByRole("button", { name: "Submit" }).click();
  await expect(page.getByLabel("Resolution, m")).toHaveAttribute("aria-invalid", "true");
  await judge(page);
});
