// Places before a service that has them, and before one that has not.

import { type Page } from "@playwright/test";
import { expect, knows, open, otherMap, roomMap, test } from "./fixtures";

/** Stands in for a service's places, in memory. */
async function standIn(page: Page): Promise<void> {
  const versions: { name: string; version: number; map_id: string; published: string; note: string | null }[] = [];
  const now = () => versions.at(-1);
  const put = (map_id: string, note: string | null = null) =>
    versions.push({ name: "lab", version: versions.length + 1, map_id, published: new Date().toISOString(), note });
  await page.route("**/openapi.json", async (route) => {
    const document = await (await route.fetch()).json();
    Object.assign(document.paths, { "/v1/places": { get: {} }, "/v1/places/{name}": { get: {}, put: {} } });
    await route.fulfill({ json: document });
  });
  await page.route(/\/v1\/places(\?|$)/, (route) =>
    route.fulfill({ json: { items: versions.slice(-1), next_cursor: null } }),
  );
  await page.route("**/v1/places/lab", (route) => {
    if (route.request().method() === "PUT")
      put(route.request().postDataJSON().map_id, route.request().postDataJSON().note);
    if (route.request().method() === "DELETE") versions.length = 0;
    return route.fulfill(now() ? { json: now() } : { status: 204 });
  });
  await page.route("**/v1/places/lab/versions*", (route) =>
    route.fulfill({ json: { items: [...versions].reverse(), next_cursor: null } }),
  );
  await page.route("**/v1/places/lab/rollback", (route) => {
    put(versions.find((one) => one.version === route.request().postDataJSON().version)?.map_id ?? "");
    return route.fulfill({ json: now() });
  });
}

test("a map is published, followed by another, and rolled back", async ({ page }) => {
  if (!(await knows("/v1/places"))) await standIn(page);
  await open(page, "#/places");
  await page.getByLabel("Name").fill("lab");
  await page.getByLabel("Map").selectOption(roomMap());
  await page.getByRole("button", { name: "Publish" }).click();
  await expect(page.getByRole("heading", { level: 1 })).toHaveText("lab");
  await expect(page.getByText("Version 1, published")).toBeVisible();
  await page.getByLabel("Map").selectOption(otherMap());
  await page.getByRole("button", { name: "Publish" }).click();
  await expect(page.getByText("Version 2, published")).toBeVisible();
  await page.getByRole("button", { name: "Roll back to version 1" }).click();
  await page.getByRole("dialog").getByRole("button", { name: "Roll back" }).click();
  await expect(page.getByText("Version 3, published")).toBeVisible();
  await page.getByRole("button", { name: "Delete the place" }).click();
  await page.getByRole("button", { name: "Delete it" }).click();
  await expect(page.getByRole("heading", { level: 1 })).toHaveText("Places");
});

test("a service without places says so", async ({ page }) => {
  await page.route("**/openapi.json", (route) => route.fulfill({ json: { paths: {} } }));
  await open(page, "#/places");
  await expect(page.getByText("This service has no places")).toBeVisible();
});
