import { drawn, drop, expect, open, tabTo, test } from "./fixtures";
import { room } from "./room";
import { Service, consoleOf } from "./service";

test("a wrong key is refused in words, a right one is sent with everything", async ({ page }) => {
  const mapfit = await Service.prepare("--workers", "0");
  const ends = [() => mapfit.end()];
  try {
    const right = mapfit.key("read");
    await mapfit.resume();
    await open(page, "#/jobs", await consoleOf(mapfit.url, ends));
    await tabTo(page, page.getByRole("link", { name: "Enter an API key" }));
    await page.keyboard.press("Enter");
    await tabTo(page, page.getByLabel("Key", { exact: true }));
    await page.keyboard.type("wrong");
    await page.keyboard.press("Enter");
    await expect(page.getByRole("alert")).toContainText(/key/i);
    await expect(page.getByLabel("Key", { exact: true })).toBeFocused();
    await page.keyboard.press("Control+A");
    await page.keyboard.type(right);
    await page.keyboard.press("Enter");
    await expect(page.getByText("It is kept until this tab is closed.")).toBeVisible();
    await tabTo(page, page.getByRole("link", { name: "To the jobs" }));
    await page.keyboard.press("Enter");
    await expect(page.getByText("No jobs yet")).toBeVisible();
    expect(await page.evaluate(() => [localStorage.length, document.cookie])).toEqual([0, ""]);
    // A key that may read may not delete: the service's words, and another key as the next step.
    const answer = await page.evaluate(async () => {
      const key = sessionStorage.getItem("mapfit-key");
      return (await fetch("/v1/places/x", { method: "DELETE", headers: { authorization: `Bearer ${key}` } })).status;
    });
    expect(answer).toBe(403);
    await page.goto(page.url().replace(/#.*/, "#/key"));
    await page.getByRole("button", { name: "Forget the key" }).click();
    await page.getByRole("link", { name: "Jobs" }).first().click();
    await expect(page.getByRole("link", { name: "Enter an API key" })).toBeVisible();
  } finally {
    for (const end of ends.reverse()) await end();
  }
});

test("with a key a job is sent and watched, its map is drawn, its files are fetched", async ({ page }) => {
  const mapfit = await Service.prepare("--workers", "1");
  const ends = [() => mapfit.end()];
  try {
    const key = mapfit.key("read,submit");
    await mapfit.resume();
    const console = await consoleOf(mapfit.url, ends);
    await open(page, "#/key", console);
    await page.getByLabel("Key", { exact: true }).fill(key);
    await page.keyboard.press("Enter");
    await expect(page.getByText("It is kept until this tab is closed.")).toBeVisible();
    await page.goto(page.url().replace(/#.*/, "#/submit"));
    await drop(page, "lab.json", JSON.stringify(room({ name: "locked" })));
    await page.getByRole("button", { name: "Submit" }).click();
    await expect(page.getByRole("heading", { level: 1 })).toHaveText("locked");
    const tile = page.waitForResponse((response) => response.url().includes("/tiles/"));
    await page.getByRole("link", { name: /Open map/ }).click();
    expect((await tile).status()).toBe(200);
    await drawn(page);
    const begun = page.waitForEvent("download");
    await page.locator(".downloads li a").first().click();
    expect(await (await begun).failure()).toBeNull();
    // What the key may not do is said in the service's words.
    await page.goto(page.url().replace(/#.*/, "#/places"));
    await page.getByLabel("Name", { exact: true }).fill("hall");
    await expect(page.locator("#place-map option")).toHaveCount(1);
    await page.getByRole("button", { name: "Publish" }).click();
    await expect(page.getByRole("alert")).toContainText("admin");
  } finally {
    for (const end of ends.reverse()) await end();
  }
});
