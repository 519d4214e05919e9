import { expect, open, tabTo, test } from "./fixtures";
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
