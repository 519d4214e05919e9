import { execFileSync } from "node:child_process";
import { mkdtempSync, statSync } from "node:fs";
import { tmpdir } from "node:os";
import { expect, open, openMap, otherMap, roomMap, service, test } from "./fixtures";

test("opens fitted, with every layer as tiles of the view", async ({ page }) => {
  await openMap(page);
  await expect(page.getByRole("heading", { level: 1 })).toHaveText("room");
  for (const layer of ["sigma", "occupancy", "clearance", "distance"]) {
    const tile = page.waitForResponse((response) => response.url().includes(`/tiles/${layer}/`));
    await page.getByRole("radio", { name: layer, exact: false }).check();
    expect((await tile).status()).toBe(200);
    await expect(page).toHaveURL(layer === "distance" ? /^(?!.*layer=)/ : new RegExp(`layer=${layer}`));
  }
  await page.goBack();
  await expect(page.getByRole("radio", { name: "Clearance" })).toBeChecked();
  await page.goBack();
  await expect(page.getByRole("radio", { name: "Occupancy" })).toBeChecked();
});

test("a click tells what /query tells", async ({ page }) => {
  await openMap(page);
  await page.locator(".map").click({ position: { x: 420, y: 330 } });
  await expect(page.locator(".answer").first()).toContainText("Distance");
  const [x, y] = (/at=([^,&]+),([^&]+)/.exec(page.url()) ?? []).slice(1).map(Number) as [number, number];
  const init = {
    method: "POST",
    headers: { "content-type": "application/json" },
    body: JSON.stringify({ points: [[x, y]] }),
  };
  const asked = await (await fetch(`${service()}/v1/maps/${roomMap()}/query`, init)).json();
  const metres = (value: number) => {
    const size = Math.abs(value);
    const text = size < 0.1 ? `${(value * 1000).toFixed(size < 0.01 ? 1 : 0)} mm` : `${value.toFixed(3)} m`;
    return text.replace("-", "\u2212");
  };
  await expect(page.locator(".answer").first()).toContainText(
    `${metres(asked.distance[0])} ± ${metres(asked.sigma[0])}`,
  );
  await expect(page.locator(".answer").first()).toContainText(metres(asked.clearance[0]));
  await page.reload();
  await expect(page.locator(".answer").first()).toContainText(metres(asked.distance[0]));
  await page.getByRole("radio", { name: "Posterior" }).check();
  await expect(page.locator(".answer").first()).toContainText("posterior");
});

test("the ruler measures, and Back takes it away", async ({ page }) => {
  await openMap(page);
  await page.getByRole("radio", { name: "Ruler" }).check();
  await page.locator(".map").click({ position: { x: 300, y: 300 } });
  await page.locator(".map").click({ position: { x: 500, y: 300 } });
  await expect(page.getByText("Length")).toBeVisible();
  const ends = (/ruler=([^&]+)/.exec(page.url())?.[1] ?? "").split(",").map(Number) as [number, number, number, number];
  await expect(page.locator(".answer").nth(1)).toContainText(
    `${Math.hypot(ends[2] - ends[0], ends[3] - ends[1]).toFixed(3)} m`,
  );
  await page.goBack();
  await expect(page.getByText("Length")).toBeHidden();
});

test("overlays: surfaces, returns and poses", async ({ page }) => {
  await openMap(page);
  await page.getByRole("checkbox", { name: /Returns/ }).check();
  await expect(page.getByText("724", { exact: true })).toBeVisible();
  await page.getByRole("checkbox", { name: /Poses/ }).check();
  await expect(page.getByRole("region", { name: "Legend" })).toContainText("2σ ellipse");
  await expect(page).toHaveURL(/show=contour,returns,poses/);
  await page.reload();
  await expect(page.getByRole("checkbox", { name: /Poses/ })).toBeChecked();
});

test("two maps beside a moving edge", async ({ page }) => {
  await openMap(page);
  await page.getByRole("combobox", { name: "Swipe against" }).selectOption(otherMap());
  const edge = page.getByRole("slider", { name: "Edge between the two maps" });
  await edge.focus();
  await page.keyboard.press("ArrowRight");
  await expect(page).toHaveURL(/compare=.*swipe=0.51/);
  await page.goBack();
  await page.goBack();
  await expect(edge).toBeHidden();
});

test("keyboard alone: pan, zoom, ask", async ({ page }) => {
  await openMap(page);
  await page.locator(".map").focus();
  await page.keyboard.press("+");
  await page.keyboard.press("ArrowLeft");
  await page.waitForTimeout(600);
  await page.keyboard.press("Enter");
  await expect(page.locator(".answer").first()).toContainText("Distance");
});

test("every download answers, by its link and by the lines to copy", async ({ page }) => {
  test.setTimeout(120_000);
  await openMap(page);
  const links = page.locator(".downloads li");
  const folder = mkdtempSync(`${tmpdir()}/mapfit-lines-`);
  expect(await links.count()).toBeGreaterThan(12);
  for (const link of await links.all()) {
    const download = page.waitForEvent("download");
    await link.locator("a").click();
    const file = await (await download).path();
    expect(statSync(file).size).toBeGreaterThan(20);
    await link.locator("summary").click();
    for (const [k, program] of [
      ["bash", "-c"],
      ["python3", "-c"],
    ].entries()) {
      const line = await link.locator(".copyable code").nth(k).innerText();
      execFileSync(program[0] as string, [program[1] as string, line], { cwd: folder });
    }
  }
});

test("never empty without a reason: no such map, tiles that fail", async ({ page }) => {
  await open(page, "#/maps/01a21697-0000-74a0-846a-6293a8ae2e6a");
  await expect(page.getByRole("alert")).toContainText("there is no map");
  await expect(page.getByRole("link", { name: "To the maps" })).toBeVisible();
  let broken = true;
  await page.route("**/tiles/**", (route) =>
    broken
      ? route.fulfill({
          status: 503,
          contentType: "application/problem+json",
          body: '{"title":"Busy","detail":"too much to do"}',
        })
      : route.fallback(),
  );
  await open(page, `#/maps/${roomMap()}`);
  await expect(page.getByRole("alert")).toContainText("too much to do");
  broken = false;
  const tile = page.waitForResponse((response) => response.url().includes("/tiles/") && response.ok());
  await page.getByRole("button", { name: "Try again" }).click();
  await tile;
  await expect(page.getByRole("alert")).toBeHidden();
});

test("outside the map it says so", async ({ page }) => {
  await openMap(page, "?at=500,500");
  await expect(page.locator(".answer").first()).toContainText("Outside this map");
});
