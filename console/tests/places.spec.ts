import { expect, open, otherMap, roomMap, service, test } from "./fixtures";

test("a map is published, followed by another, and rolled back", async ({ page }) => {
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
  // What robots are answered is the first map again.
  const robot = await (await fetch(`${service()}/v1/places/lab`)).json();
  expect(robot).toMatchObject({ version: 3, map_id: roomMap() });
  // Someone else publishing a new place of this name is not overrun.
  await open(page, "#/places");
  await page.getByLabel("Name").fill("lab");
  await page.getByRole("button", { name: "Publish" }).click();
  await expect(page.getByRole("alert")).toBeVisible();
  await page.getByRole("link", { name: "lab", exact: true }).click();
  await page.getByRole("button", { name: "Delete the place" }).click();
  await page.getByRole("button", { name: "Delete it" }).click();
  await expect(page.getByRole("heading", { level: 1 })).toHaveText("Places");
});

test("a service without places says so", async ({ page }) => {
  await page.route("**/openapi.json", (route) => route.fulfill({ json: { paths: {} } }));
  await open(page, "#/places");
  await expect(page.getByText("This service has no places")).toBeVisible();
});
