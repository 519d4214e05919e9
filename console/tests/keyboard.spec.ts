// All of it without a mouse: Tab, arrows, Enter and Space alone.

import type { FileChooser, Page } from "@playwright/test";
import { ask } from "./api";
import { drawn, expect, open, openMap, otherMap, recording, service, submit, tabTo, test } from "./fixtures";
import { carmen, room } from "./room";

/** What the Space key opens on a file's field. A browser without a screen swallows a first press now and then. */
async function opened(page: Page): Promise<FileChooser> {
  for (let presses = 0; presses < 5; presses += 1) {
    const chooser = page.waitForEvent("filechooser", { timeout: 5000 }).catch(() => null);
    await page.keyboard.press("Space");
    const found = await chooser;
    if (found) return found;
  }
  throw new Error("the Space key chooses no file");
}

/** Chooses a file by keyboard: the field takes focus though the eye sees a button. */
async function choose(page: Page, name: string, content: string | Buffer): Promise<void> {
  await tabTo(page, page.locator("#file"));
  const chooser = await opened(page);
  await chooser.setFiles({ name, mimeType: "application/octet-stream", buffer: Buffer.from(content) });
}

test("a job is submitted, watched to its map, and the map asked", async ({ page }) => {
  await open(page, "#/jobs");
  await page.keyboard.press("Tab");
  await expect(page.getByRole("link", { name: "Skip to the content" })).toBeFocused();
  await tabTo(page, page.getByRole("link", { name: "Submit", exact: true }));
  await page.keyboard.press("Enter");
  await expect(page.getByRole("heading", { level: 1 })).toBeFocused();
  await choose(page, "lab.json", JSON.stringify(room({ name: "by hand" })));
  await expect(page.getByLabel("Name")).toBeFocused();
  await tabTo(page, page.getByLabel("Resolution, m"));
  await page.keyboard.press("Control+A");
  await page.keyboard.type("0.3");
  await tabTo(page, page.getByRole("button", { name: "Submit" }));
  await page.keyboard.press("Enter");
  await expect(page.getByRole("heading", { level: 1 })).toHaveText("by hand");
  await tabTo(page, page.getByRole("link", { name: /Open map/ }));
  await page.keyboard.press("Enter");
  await drawn(page);
  await tabTo(page, page.locator(".map"));
  await page.keyboard.press("+");
  await page.keyboard.press("ArrowLeft");
  await page.keyboard.press("Enter");
  await expect(page.locator(".answer").first()).toContainText("Distance");
  await page.goBack();
  await expect(page.locator(".answer").first()).not.toContainText("Distance");
});

for (const [name, content, what] of [
  ["walk.log", carmen, "walk.log: 6 scans, 972 returns"],
  ["drive.mcap", () => recording("drive-zstd.mcap"), "drive.mcap: 2 scans, 362 returns"],
] as const) {
  test(`${name} is chosen and sent`, async ({ page }) => {
    await open(page, "#/submit");
    await choose(page, name, content());
    await expect(page.getByText(what)).toBeVisible();
    await tabTo(page, page.getByRole("button", { name: "Submit" }));
    await page.keyboard.press("Enter");
    await expect(page.locator(".chip")).toHaveText("done");
  });
}

test("layers, overlays, ruler and swipe", async ({ page }) => {
  await openMap(page);
  await tabTo(page, page.getByRole("radio", { name: "Ask" }));
  await page.keyboard.press("ArrowRight");
  await tabTo(page, page.locator(".map"));
  await page.keyboard.press("Enter");
  await expect(page.getByText("take the other end")).toBeVisible();
  const before = page.url();
  await page.keyboard.press("ArrowRight");
  await expect(page).not.toHaveURL(before);
  await page.keyboard.press("Enter");
  await expect(page.getByText("Length")).toBeVisible();
  await tabTo(page, page.getByRole("button", { name: "Clear the ruler" }));
  await page.keyboard.press("Enter");
  await expect(page.getByText("Length")).toBeHidden();

  await tabTo(page, page.getByRole("radio", { name: "Distance" }));
  for (const layer of ["sigma", "occupancy", "clearance"]) {
    await page.keyboard.press("ArrowRight");
    await expect(page).toHaveURL(new RegExp(`layer=${layer}`));
  }
  await tabTo(page, page.getByRole("radio", { name: "Propagated" }));
  await page.keyboard.press("ArrowRight");
  await expect(page).toHaveURL(/kind=posterior/);
  await tabTo(page, page.getByLabel("Opacity of the colours"));
  await page.keyboard.press("ArrowLeft");
  await expect(page).toHaveURL(/opacity=0.95/);
  await tabTo(page, page.getByRole("checkbox", { name: /Poses/ }));
  await page.keyboard.press("Space");
  await expect(page).toHaveURL(/show=contour,poses/);

  const other = await ask<{ name: string; created: string }>(service(), "GET", `/v1/maps/${otherMap()}`);
  await tabTo(page, page.getByRole("combobox", { name: "Swipe against" }));
  await page.keyboard.type(other.name);
  await expect(page).toHaveURL(new RegExp(`compare=${otherMap()}`));
  await tabTo(page, page.getByRole("slider", { name: "Edge between the two maps" }));
  await page.keyboard.press("ArrowLeft");
  await expect(page).toHaveURL(/swipe=0.49/);
});

test("every download, and its lines", async ({ page }) => {
  await openMap(page);
  const rows = await page.locator(".downloads li").all();
  expect(rows.length).toBeGreaterThan(10);
  for (const [k, row] of rows.entries()) {
    await tabTo(page, row.getByRole("link"));
    // One by its key; Chromium starts ten of a page at most, and downloads.spec.ts takes them all.
    if (k === 0) {
      const download = page.waitForEvent("download");
      await page.keyboard.press("Enter");
      expect(await (await download).failure()).toBeNull();
    }
    await tabTo(page, row.locator("summary"));
  }
  await page.keyboard.press("Enter");
  await tabTo(
    page,
    page
      .locator(".downloads li")
      .last()
      .getByRole("button", { name: /Copy: curl/ }),
  );
  await page.keyboard.press("Enter");
  await expect(page.locator("#said")).toContainText(/Copied|Ctrl-C/);
});

test("scans are located", async ({ page }) => {
  await openMap(page);
  await choose(page, "robot.json", JSON.stringify(room({ name: "" })));
  await expect(page.getByText("robot.json: 4 of 4 scans located.")).toBeVisible();
  await tabTo(page, page.getByRole("button", { name: "Show Scan 1" }));
  await page.keyboard.press("Enter");
  await tabTo(page, page.getByRole("button", { name: "Clear the scans" }));
  await page.keyboard.press("Enter");
  await expect(page.locator("#file")).toBeFocused();
});

test("jobs are filtered, one is cancelled and tried again", async ({ page }) => {
  await submit(room({ name: "by keyboard", scans: 160, beams: 720, resolution: 0.04 }));
  await open(page, "#/jobs");
  await tabTo(page, page.getByRole("radio", { name: "all" }));
  await page.keyboard.press("ArrowRight");
  await expect(page).toHaveURL(/status=accepted/);
  await page.keyboard.press("ArrowRight");
  await expect(page).toHaveURL(/status=running/);
  await tabTo(page, page.getByRole("button", { name: "Cancel by keyboard" }));
  await page.keyboard.press("Enter");
  await tabTo(page, page.getByRole("button", { name: "Cancel the job" }));
  await page.keyboard.press("Enter");
  await expect(page.getByRole("link", { name: "by keyboard" })).toBeHidden();
  await open(page, "#/jobs?status=dismissed");
  await tabTo(page, page.getByRole("button", { name: "Retry by keyboard" }));
  await page.keyboard.press("Enter");
  await expect(page.getByText("Retry of")).toBeVisible();
  await tabTo(page, page.getByRole("button", { name: "Cancel by keyboard" }));
  await page.keyboard.press("Enter");
  await tabTo(page, page.getByRole("button", { name: "Cancel the job" }));
  await page.keyboard.press("Enter");
  await expect(page.locator(".chip")).toHaveText("cancelled");
});

test("a map is published and rolled back", async ({ page }) => {
  await open(page, "#/places");
  await tabTo(page, page.getByLabel("Name"));
  await page.keyboard.type("kitchen");
  await tabTo(page, page.getByLabel("Map"));
  await tabTo(page, page.getByRole("button", { name: "Publish" }));
  await page.keyboard.press("Enter");
  await expect(page.getByRole("heading", { level: 1 })).toHaveText("kitchen");
  await tabTo(page, page.getByLabel("Note"));
  await page.keyboard.type("again");
  await page.keyboard.press("Enter");
  await expect(page.getByText("Version 2, published")).toBeVisible();
  await tabTo(page, page.getByRole("button", { name: "Roll back to version 1" }));
  await page.keyboard.press("Enter");
  await tabTo(page, page.getByRole("dialog").getByRole("button", { name: "Roll back" }));
  await page.keyboard.press("Enter");
  await expect(page.getByText("Version 3, published")).toBeVisible();
  await ask(service(), "DELETE", "/v1/places/kitchen");
});
