// axe-core on every page: light, dark, wide and narrow; no violation of any level, contrast of 7 to 1 included.

import AxeBuilder from "@axe-core/playwright";
import { drop, expect, open, openMap, otherMap, service, submit, test } from "./fixtures";
import { carmen, room } from "./room";

const ADDRESSES = [
  "#/jobs",
  "#/jobs?status=failed&label=a:b",
  "#/maps",
  "#/submit",
  "#/places",
  "#/key",
  "#/nowhere",
  "#/maps/none",
];

for (const colorScheme of ["light", "dark"] as const) {
  for (const width of [1280, 390]) {
    test.describe(`${colorScheme}, ${width} pixels`, () => {
      test.use({ colorScheme, viewport: { width, height: 800 } });

      test("every page is accessible", async ({ page }) => {
        await open(page, "#/jobs");
        for (const address of ADDRESSES) {
          await page.goto(`/${address}`);
          await expect(page.locator("main [aria-busy], main [role=status]:text('Loading')")).toHaveCount(0);
          await judge(page);
        }
      });

      test("a map with everything on it is accessible", async ({ page }) => {
        await openMap(page, `?show=contour,returns,poses&at=2,2&ruler=1,1,3,3&compare=${otherMap()}`);
        await expect(page.locator(".answer").first()).toContainText("Distance");
        await page.locator(".downloads summary").first().click();
        await judge(page);
      });

      test("a job and a question are accessible", async ({ page }) => {
        const id = await submit(room({ name: "asked", scans: 160, beams: 720, resolution: 0.04 }));
        await open(page, `#/jobs/${id}`);
        await expect(page.locator(".chip")).toHaveText(/running|waiting/);
        await judge(page);
        await page.getByRole("button", { name: /Cancel/ }).click();
        await judge(page);
        await fetch(`${service()}/v1/jobs/${id}`, { method: "DELETE" });
      });

      test("a submission is accessible", async ({ page }) => {
        await open(page, "#/submit");
        await drop(page, "walk.log", carmen());
        await expect(page.locator(".forecast")).toContainText("control points");
        await page.getByText("More", { exact: true }).click();
        await judge(page);
      });
    });
  }
}

async function judge(page: import("@playwright/test").Page): Promise<void> {
  const rules = { "color-contrast-enhanced": { enabled: true }, "target-size": { enabled: true } };
  const { violations } = await new AxeBuilder({ page }).options({ rules }).analyze();
  const found = violations.map(
    ({ id, impact, nodes }) =>
      `${id} (${impact}): ${nodes.map((node) => `${node.target} ${node.failureSummary}`).join("; ")}`,
  );
  expect(found).toEqual([]);
  const wider = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
  expect(wider, "the page scrolls sideways").toBeLessThanOrEqual(0);
}
