import { drawn, expect, open, openMap, otherMap, picture, roomMap, service, test, vectorMap } from "./fixtures";
import { ask } from "./api";

interface Answers {
  distance: number[];
  sigma: number[];
  clearance: number[];
  nearest: [number, number][];
  gradient: [number, number][];
}

/** A length, and a pair of coordinates, as the console writes them. */
const metres = (value = Number.NaN) => {
  const size = Math.abs(value);
  const text = size < 0.1 ? `${(value * 1000).toFixed(size < 0.01 ? 1 : 0)} mm` : `${value.toFixed(3)} m`;
  return text.replace("-", "\u2212");
};
const pair = ([x, y]: [number, number] = [Number.NaN, Number.NaN]) =>
  `(${x.toFixed(3)}, ${y.toFixed(3)})`.replaceAll("-", "\u2212");

test("opens fitted, with every layer as tiles of the view", async ({ page }) => {
  await openMap(page);
  await expect(page.getByRole("heading", { level: 1 })).toHaveText("room");
  const pictures = new Set<string>();
  for (const layer of ["sigma", "occupancy", "clearance", "distance"]) {
    const tile = page.waitForResponse((response) => response.url().includes(`/tiles/${layer}/`));
    await page.getByRole("radio", { name: layer, exact: false }).check();
    expect((await tile).status()).toBe(200);
    await expect(page).toHaveURL(layer === "distance" ? /^(?!.*layer=)/ : new RegExp(`layer=${layer}`));
    pictures.add(await picture(page));
  }
  expect(pictures.size, "every layer looks different").toBe(4);
  await page.goBack();
  await expect(page.getByRole("radio", { name: "Clearance" })).toBeChecked();
  await page.goBack();
  await expect(page.getByRole("radio", { name: "Occupancy" })).toBeChecked();
});

for (const [distance, id] of [
  ["signed", roomMap],
  ["vector", vectorMap],
] as const) {
  test(`a click on a ${distance} map tells what /query tells`, async ({ page }) => {
    await openMap(page, "", id());
    await page.locator(".map").click({ position: { x: 420, y: 330 } });
    const answer = page.locator(".answer").first();
    await expect(answer).toContainText("Distance");
    const [x, y] = (/at=([^,&]+),([^&]+)/.exec(page.url()) ?? []).slice(1).map(Number) as [number, number];
    const told = await ask<Answers>(service(), "POST", `/v1/maps/${id()}/query`, { points: [[x, y]] });
    const fact = (name: string) => answer.locator("dt", { hasText: name }).locator("xpath=following-sibling::dd");
    await expect(fact("Distance")).toHaveText(`${metres(told.distance[0])} ± ${metres(told.sigma[0])}`);
    await expect(fact("Clearance")).toHaveText(metres(told.clearance[0]));
    await expect(fact("Nearest surface")).toHaveText(`${pair(told.nearest[0])} m`);
    await expect(fact("Gradient")).toContainText(pair(told.gradient[0]));
    await page.reload();
    await expect(fact("Distance")).toContainText(metres(told.distance[0]));
    await page.getByRole("radio", { name: "Posterior" }).check();
    await expect(answer).toContainText("posterior");
  });
}

test("the ruler measures, and Back takes it away", async ({ page }) => {
  await openMap(page);
  await page.getByRole("radio", { name: "Ruler" }).check();
  await page.locator(".map").click({ position: { x: 300, y: 300 } });
  await expect(page.getByText("take the other end")).toBeVisible();
  await page.locator(".map").click({ position: { x: 500, y: 300 } });
  await expect(page.getByText("Length")).toBeVisible();
  const ends = (/ruler=([^&]+)/.exec(page.url())?.[1] ?? "").split(",").map(Number) as [number, number, number, number];
  await expect(page.locator(".answer").nth(1)).toContainText(
    `${Math.hypot(ends[2] - ends[0], ends[3] - ends[1]).toFixed(3)} m`,
  );
  await page.goBack();
  await expect(page.getByText("Length")).toBeHidden();
});

test("overlays: surfaces, returns and poses, each of which shows", async ({ page }) => {
  await openMap(page, "?show=none");
  const bare = await picture(page);
  const seen = [bare];
  for (const overlay of [/Surfaces/, /Returns/, /Poses/]) {
    await page.getByRole("checkbox", { name: overlay }).check();
    await expect.poll(async () => seen.includes(await picture(page)), `${overlay} changes the picture`).toBe(false);
    seen.push(await picture(page));
  }
  await expect(page.getByText("724", { exact: true })).toBeVisible();
  await expect(page.getByRole("region", { name: "Legend" })).toContainText("2σ ellipse");
  await expect(page).toHaveURL(/show=contour,returns,poses/);
  await page.reload();
  for (const overlay of [/Surfaces/, /Returns/, /Poses/]) {
    await expect(page.getByRole("checkbox", { name: overlay })).toBeChecked();
    await page.getByRole("checkbox", { name: overlay }).uncheck();
  }
  await expect.poll(() => picture(page), "without any it is as it was").toBe(bare);
});

test("the scale bar and the coordinates agree, at any zoom", async ({ page }) => {
  await openMap(page);
  for (const zoom of ["Zoom in", "Zoom in", "Zoom out"]) {
    const map = await page.locator(".map").boundingBox();
    const pointed = async (right: number) => {
      await page.mouse.move((map?.x ?? 0) + right, (map?.y ?? 0) + 300);
      const text = (await page.locator(".coordinates").innerText()).replace("\u2212", "-");
      return Number(/^x (\S+)\s+y \S+ m$/.exec(text)?.[1]);
    };
    const metresAPixel = ((await pointed(500)) - (await pointed(300))) / 200;
    const bar = Number.parseFloat(await page.locator(".scale-line span").innerText());
    const width = (await page.locator(".scale-bar").boundingBox())?.width ?? 0;
    expect(width).toBeGreaterThan(40);
    // Coordinates are rounded to the millimetre, the bar has a border on either side.
    expect(bar / metresAPixel / width).toBeCloseTo(1, 1);
    await page.getByRole("button", { name: zoom }).click();
    await drawn(page);
  }
  await page.mouse.move(5, 5);
  await expect(page.locator(".coordinates")).toHaveText("");
});

test("two maps beside a moving edge", async ({ page }) => {
  await openMap(page);
  const alone = await picture(page);
  await page.getByRole("combobox", { name: "Swipe against" }).selectOption(otherMap());
  const edge = page.getByRole("slider", { name: "Edge between the two maps" });
  await edge.focus();
  await page.keyboard.press("ArrowRight");
  await expect(page).toHaveURL(/compare=.*swipe=0.51/);
  // With the edge at either end, one of the two is all there is.
  await page.keyboard.press("Home");
  await expect(page).toHaveURL(/swipe=0$|swipe=0&/);
  const other = await picture(page);
  await page.keyboard.press("End");
  await expect(page).toHaveURL(/swipe=1/);
  expect(await picture(page)).toBe(alone);
  expect(other).not.toBe(alone);
  for (let back = 0; back < 4; back += 1) await page.goBack();
  await expect(edge).toBeHidden();
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

test("never empty without a reason: out of view, or hidden", async ({ page }) => {
  await open(page, `#/maps/${roomMap()}?view=500,500,0.01`);
  await expect(page.getByText("The map is out of view")).toBeVisible();
  await page.getByRole("button", { name: "Show the whole map" }).last().click();
  await expect(page.getByText("The map is out of view")).toBeHidden();
  await open(page, `#/maps/${roomMap()}?opacity=0&show=none`);
  await page.getByRole("button", { name: "Show the colours" }).click();
  await expect(page.getByText("Everything is hidden")).toBeHidden();
  await expect(page).not.toHaveURL(/opacity/);
});

test("on a narrow screen the answer stands on the map, too", async ({ page }) => {
  await page.setViewportSize({ width: 390, height: 844 });
  await openMap(page, "?at=2,2");
  await expect(page.locator(".answer").first()).toContainText("Distance");
  await expect(page.locator(".readout")).toHaveText(/m ± .* mm/);
  await expect(page.locator(".readout")).toBeInViewport();
});

test("outside the map it says so", async ({ page }) => {
  await openMap(page, "?at=500,500");
  await expect(page.locator(".answer").first()).toContainText("Outside this map");
});
