import { expect, knows, open, service, submit, test } from "./fixtures";
import { room } from "./room";

/** Long enough to be watched and stopped. */
const long = (name: string) => room({ name, scans: 160, beams: 720, resolution: 0.04 });

test("a job is watched, its row keeps focus, and it is cancelled after a question", async ({ page }) => {
  await submit(long("long one"));
  await open(page, "#/jobs");
  const row = page.getByRole("listitem").filter({ hasText: "long one" });
  const cancel = row.getByRole("button", { name: "Cancel long one" });
  await expect(row.locator(".chip")).toHaveText("running");
  await cancel.focus();
  // Two refreshes and any number of events later, focus is where it was.
  await page.waitForTimeout(6500);
  await expect(cancel).toBeFocused();
  await page.keyboard.press("Enter");
  await expect(page.getByRole("dialog")).toContainText("Cancel long one?");
  await page.keyboard.press("Escape");
  await expect(row.locator(".chip")).toHaveText("running");
  await cancel.click();
  await page.getByRole("button", { name: "Cancel the job" }).click();
  await expect(row.locator(".chip")).toHaveText("cancelled");
  const retry = row.getByRole("button", { name: "Retry long one" });
  if (!(await knows("/v1/jobs/{id}/retry"))) return expect(retry).toBeHidden();
  await retry.click();
  await expect(page.getByText("Retry of")).toBeVisible();
  await page.getByRole("button", { name: /Cancel/ }).click();
  await page.getByRole("button", { name: "Cancel the job" }).click();
  await expect(page.locator(".chip")).toHaveText("cancelled");
});

test("a job's page survives a reload and a lost connection", async ({ page }) => {
  const id = await submit(long("followed"));
  // The first connection breaks off after one event, and for a while there is none.
  let connections = 0;
  const progress = `event: progress\nid: 2\ndata: {"percent":7,"stage":"fitting","iteration":1,"max_iterations":100}\n\n`;
  await page.route("**/events", (route) => {
    connections += 1;
    if (connections === 1) return route.fulfill({ contentType: "text/event-stream", body: progress });
    if (connections < 4) return route.abort();
    if (connections === 4) expect(route.request().headers()["last-event-id"]).toBe("2");
    return route.fallback();
  });
  await page.goto(`/#/jobs/${id}`);
  const lost = page.getByText("The connection is lost");
  await expect(lost).toBeVisible();
  await expect(lost).toBeHidden({ timeout: 15_000 });
  await page.reload();
  await expect(page.locator(".chip")).toHaveText("running");
  await page.getByRole("button", { name: /Cancel/ }).click();
  await page.getByRole("button", { name: "Cancel the job" }).click();
  await expect(page.locator(".chip")).toHaveText("cancelled");
});

test("why a job failed is said in the list and on its page", async ({ page }) => {
  const one = {
    id: "01a21697-2cdd-74a0-846a-6293a8ae2e6a",
    name: "hopeless",
    labels: {},
    status: "failed",
    progress: { percent: 40, stage: "fitting", iteration: 3, max_iterations: 100 },
    message: null,
    created: "2026-11-26T06:41:19.434Z",
    started: "2026-11-26T06:41:20Z",
    finished: "2026-11-26T06:41:29Z",
    updated: "2026-11-26T06:41:29Z",
    attempt: 1,
    priority: 0,
    map_id: null,
    problem: {
      type: "/problems/ill-determined",
      title: "The map is ill-determined",
      status: 422,
      detail: "nothing fixes its turn",
    },
    links: {},
  };
  await page.route(`**/v1/jobs/${one.id}`, (route) => route.fulfill({ json: one }));
  await page.route("**/v1/jobs?*", (route) => route.fulfill({ json: { items: [one], next_cursor: null } }));
  await open(page, "#/jobs");
  await expect(page.getByText("The map is ill-determined: nothing fixes its turn")).toBeVisible();
  await page.getByRole("link", { name: "hopeless" }).click();
  await expect(page.getByRole("alert")).toContainText("nothing fixes its turn");
});

test("filters and pages are addresses, and Back undoes them", async ({ page }) => {
  await open(page, "#/jobs");
  await page.getByRole("radio", { name: "done" }).check();
  await expect(page).toHaveURL(/status=successful/);
  await expect(page.locator(".job").first()).toBeVisible();
  await page.getByRole("radio", { name: "failed" }).check();
  await expect(page.getByText("No job is like this")).toBeVisible();
  await page.goBack();
  await expect(page.getByRole("radio", { name: "done" })).toBeChecked();
  await page.getByRole("searchbox", { name: "Label" }).fill("site:test");
  await page.keyboard.press("Enter");
  await expect(page).toHaveURL(/label=site:test/);
  await expect(page.locator(".job")).toHaveCount(2);
  await page.goBack();
  await page.goBack();
  await expect(page.getByRole("radio", { name: "all" })).toBeChecked();
});

test("five thousand jobs are listed and filtered without a stall", async ({ page }) => {
  const all = Array.from({ length: 5000 }, (_, k) => ({
    id: `01a21697-2cdd-74a0-846a-${String(k).padStart(12, "0")}`,
    name: `job ${k}`,
    labels: { site: `s${k % 7}` },
    status: k % 3 ? "dismissed" : "failed",
    progress: { percent: 0, stage: "done", iteration: 0, max_iterations: 1 },
    message: null,
    created: "2026-11-26T06:41:19Z",
    started: null,
    finished: null,
    updated: null,
    attempt: 1,
    priority: 0,
    map_id: null,
    problem: null,
    links: {},
  }));
  await page.route("**/v1/jobs?*", (route) => {
    const query = new URL(route.request().url()).searchParams;
    const some = all.filter((job) => !query.get("status") || job.status === query.get("status"));
    const from = Number(query.get("cursor") ?? 0);
    const limit = Number(query.get("limit"));
    void route.fulfill({
      json: {
        items: some.slice(from, from + limit),
        next_cursor: from + limit < some.length ? String(from + limit) : null,
      },
    });
  });
  await open(page, "#/jobs");
  await page.evaluate(() => {
    const page = window as unknown as { longest: number };
    page.longest = 0;
    new PerformanceObserver((list) =>
      list.getEntries().forEach((entry) => (page.longest = Math.max(page.longest, entry.duration))),
    ).observe({ type: "longtask" });
  });
  for (let k = 0; k < 5; k += 1) {
    const first = await page.locator(".job .name").first().innerText();
    await page.getByRole("link", { name: "Older" }).click();
    await expect(page.locator(".job .name").first()).not.toHaveText(first);
  }
  await page.getByRole("radio", { name: "failed" }).check();
  await expect(page.locator(".chip").first()).toHaveText("failed");
  expect(await page.evaluate(() => (window as unknown as { longest: number }).longest)).toBeLessThan(100);
});

test("a service that is away is said, and found again", async ({ page }) => {
  await open(page, "#/jobs");
  await expect(page.getByText("live", { exact: true })).toBeVisible();
  await page.route("**/v1/jobs?*", (route) => route.abort());
  await expect(page.getByText("not up to date, trying again")).toBeVisible({ timeout: 10_000 });
  await page.unroute("**/v1/jobs?*");
  await expect(page.getByText("live", { exact: true })).toBeVisible({ timeout: 10_000 });
});

test("a wrong key is refused in words, a right one is sent with everything", async ({ page }) => {
  await page.route("**/v1/**", (route) => {
    if (route.request().headers()["authorization"] === "Bearer right") return route.fallback();
    return route.fulfill({
      status: 401,
      contentType: "application/problem+json",
      headers: { "www-authenticate": "Bearer" },
      body: '{"type":"/problems/unauthorized","title":"No API key","status":401,"detail":"send Authorization: Bearer KEY"}',
    });
  });
  await open(page, "#/jobs");
  await page.getByRole("link", { name: "Enter an API key" }).click();
  await page.getByLabel("Key", { exact: true }).fill("wrong");
  await page.keyboard.press("Enter");
  await expect(page.getByRole("alert")).toContainText("No API key");
  await page.getByLabel("Key", { exact: true }).fill("right");
  await page.keyboard.press("Enter");
  await expect(page.getByText("It is kept until this tab is closed.")).toBeVisible();
  await page.getByRole("link", { name: "To the jobs" }).click();
  await expect(page.locator(".job").first()).toBeVisible();
  expect(await page.evaluate(() => [localStorage.length, document.cookie])).toEqual([0, ""]);
  expect(service()).toBeTruthy();
});
