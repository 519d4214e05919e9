import { expect, open, service, submit, test } from "./fixtures";
import { ask } from "./api";
import { room } from "./room";
import { Service, consoleOf } from "./service";

/** Long enough to be watched and stopped. */
const long = (name: string) => room({ name, scans: 160, beams: 720, resolution: 0.04 });

test("a job is watched, its row keeps focus, and it is cancelled after a question", async ({ page }) => {
  await submit(long("long one"));
  await open(page, "#/jobs");
  const row = page.getByRole("listitem").filter({ hasText: "long one" }).first();
  const cancel = row.getByRole("button", { name: "Cancel long one" });
  await expect(row.locator(".chip")).toHaveText("running");
  await expect(row.getByRole("progressbar")).toBeVisible();
  await cancel.focus();
  // Two refreshes and any number of events later, focus is where it was.
  for (let k = 0; k < 2; k += 1) await page.waitForResponse(/\/v1\/jobs\?/);
  await expect(cancel).toBeFocused();
  await page.keyboard.press("Enter");
  await expect(page.getByRole("dialog")).toContainText("Cancel long one?");
  await page.keyboard.press("Escape");
  await expect(row.locator(".chip")).toHaveText("running");
  await cancel.click();
  await page.getByRole("button", { name: "Cancel the job" }).click();
  await expect(row.locator(".chip")).toHaveText("cancelled");
  await row.getByRole("button", { name: "Retry long one" }).click();
  await expect(page.getByText("Retry of")).toBeVisible();
  await page.getByRole("button", { name: /Cancel/ }).click();
  await page.getByRole("button", { name: "Cancel the job" }).click();
  await expect(page.locator(".chip")).toHaveText("cancelled");
});

test("a job's page survives a reload, and a service that dies and comes back", async ({ page }) => {
  const mapfit = await Service.start("--workers", "1", "--lease-seconds", "2");
  const ends = [() => mapfit.end()];
  try {
    const { id } = await ask<{ id: string }>(mapfit.url, "POST", "/v1/jobs", long("followed"));
    await page.goto(`${await consoleOf(mapfit.url, ends)}/#/jobs/${id}`);
    await expect(page.locator(".chip")).toHaveText("running");
    await page.reload();
    await expect(page.locator(".chip")).toHaveText("running");
    const lost = page.getByText("The connection is lost");
    await expect(lost).toBeHidden();
    await mapfit.kill();
    await expect(lost).toBeVisible();
    await mapfit.resume();
    // It is tried again after half a second, then after twice as long each time.
    await expect(lost).toBeHidden();
    await page.getByRole("button", { name: /Cancel/ }).click();
    await page.getByRole("button", { name: "Cancel the job" }).click();
    await expect(page.locator(".chip")).toHaveText("cancelled");
  } finally {
    for (const end of ends.reverse()) await end();
  }
});

test("events resume behind the last one that was seen", async ({ page }) => {
  const id = await submit(long("resumed"));
  let connections = 0;
  let resumed = "";
  const progress = `event: progress\nid: 2\ndata: {"percent":7,"stage":"fitting","iteration":1,"max_iterations":100}\n\n`;
  await page.route("**/events", (route) => {
    connections += 1;
    if (connections === 1) return route.fulfill({ contentType: "text/event-stream", body: progress });
    if (connections === 2) return route.abort();
    resumed = route.request().headers()["last-event-id"] ?? "none";
    return route.fallback();
  });
  await page.goto(`/#/jobs/${id}`);
  await expect.poll(() => resumed).toBe("2");
  await ask(service(), "DELETE", `/v1/jobs/${id}`);
  await expect(page.locator(".chip")).toHaveText("cancelled");
});

test("why a job failed is said in the list and on its page", async ({ page }) => {
  // Far from done in half a second on any machine.
  const name = `hopeless ${Date.now()}`;
  await submit({ ...long(name), deadline_seconds: 0.5 });
  await open(page, "#/jobs");
  const row = page.getByRole("listitem").filter({ hasText: name });
  await expect(row.locator(".chip")).toHaveText("failed");
  await expect(row).toContainText(/deadline/i);
  await page.getByRole("link", { name }).click();
  await expect(page.getByRole("alert")).toContainText(/deadline/i);
});

test("filters and pages are addresses, and Back undoes them", async ({ page }) => {
  await open(page, "#/jobs");
  await page.getByRole("radio", { name: "done" }).check();
  await expect(page).toHaveURL(/status=successful/);
  await expect(page.locator(".job").first()).toBeVisible();
  await page.getByRole("searchbox", { name: "Label" }).fill("site:test");
  await page.keyboard.press("Enter");
  await expect(page).toHaveURL(/label=site:test/);
  await expect(page.locator(".job")).toHaveCount(2);
  await page.getByRole("radio", { name: "failed" }).check();
  await expect(page.getByText("No job is like this")).toBeVisible();
  await page.goBack();
  await expect(page.getByRole("radio", { name: "done" })).toBeChecked();
  await expect(page.locator(".job")).toHaveCount(2);
  await page.goBack();
  await page.goBack();
  await expect(page.getByRole("radio", { name: "all" })).toBeChecked();
});

test("a service that is away is said, and found again", async ({ page }) => {
  await open(page, "#/jobs");
  await expect(page.getByText("live", { exact: true })).toBeVisible();
  await page.context().setOffline(true);
  await expect(page.getByText("not up to date, trying again")).toBeVisible();
  await page.context().setOffline(false);
  await expect(page.getByText("live", { exact: true })).toBeVisible();
});
