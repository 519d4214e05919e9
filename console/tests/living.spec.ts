// Maps in time: where scans were taken on a map, what changed between two, and what a map comes from.

import { ask } from "./api";
import { drop, expect, joinedMap, laterMap, openMap, otherMap, picture, roomMap, service, test } from "./fixtures";
import { carmen, room } from "./room";

interface Located {
  pose: { x: number; y: number; theta: number };
  used: number;
  left_out: number;
  chi_squared: number;
  degrees_of_freedom: number;
}

test("scans of a job are located: drawn with their ellipses, and listed as the service tells it", async ({ page }) => {
  await openMap(page);
  const before = await picture(page);
  const job = room({ name: "" });
  await page.getByLabel("σ position, m").fill("0.1");
  await page.getByLabel("σ heading, rad").fill("0.05");
  await drop(page, "robot.json", JSON.stringify(job));
  await expect(page.getByText("robot.json: 4 of 4 scans located.")).toBeVisible();
  const sighting = { scans: job.scans, noise: { ...job.noise, sigma_x: 0.1, sigma_y: 0.1, sigma_theta: 0.05 } };
  const told = await ask<{ poses: Located[] }>(service(), "POST", `/v1/maps/${roomMap()}/localize`, sighting);
  const rows = page.getByRole("list", { name: "Located scans" }).getByRole("listitem");
  await expect(rows).toHaveCount(4);
  for (const [k, scan] of told.poses.entries()) {
    const { x, y } = scan.pose;
    await expect(rows.nth(k)).toContainText(`Scan ${k} (${x.toFixed(3)}, ${y.toFixed(3)}) m`);
    await expect(rows.nth(k)).toContainText(
      `${scan.used} used, ${scan.left_out} left out; χ² ${scan.chi_squared.toFixed(0)} of ${scan.degrees_of_freedom}.`,
    );
  }
  await expect(page.getByRole("region", { name: "Legend" })).toContainText("located scan, its returns, 2σ ellipse");
  expect(await picture(page)).not.toBe(before);
  // A row leads to its scan, and Back from it.
  await page.getByRole("button", { name: "Show Scan 2" }).click();
  const { x, y } = (told.poses[2] as Located).pose;
  await expect(page).toHaveURL(new RegExp(`view=${Number(x.toFixed(2))}\\d*,${Number(y.toFixed(2))}`));
  await page.getByRole("button", { name: "Clear the scans" }).click();
  await expect(rows).toHaveCount(0);
  await expect(page.getByRole("region", { name: "Legend" })).not.toContainText("located");
});

test("without a prior a room that looks the same from two ends says so", async ({ page }) => {
  await openMap(page);
  await page.getByRole("radio", { name: "Anywhere on the map" }).check();
  await page.getByLabel("Scans at most").fill("1");
  await drop(page, "robot.json", JSON.stringify(room({ name: "" })));
  await expect(page.getByText("robot.json: 1 of 1 scan located, evenly over the file's 4.")).toBeVisible();
  await expect(page.getByRole("list", { name: "Located scans" })).toContainText(/Probability 50 %; or \(/);
});

test("a log is located, a recording and a torn file are answered with what to do", async ({ page }) => {
  await openMap(page, "", otherMap());
  await page.getByLabel("Scans at most").fill("3");
  await drop(page, "walk.log", carmen(12));
  await expect(page.getByText("walk.log: 3 of 3 scans located, evenly over the file's 12.")).toBeVisible();
  await drop(page, "drive.mcap", Buffer.from("\u0089MCAP0\r\n", "latin1"));
  await expect(page.getByRole("alert")).toContainText("mapfit localize");
  await drop(page, "torn.json", "{");
  await expect(page.getByRole("alert")).toContainText("not JSON");
});

test("changes between two maps are drawn, listed and told as the service tells them", async ({ page }) => {
  await openMap(page, `?compare=${roomMap()}`, otherMap());
  const before = await picture(page);
  await page.getByRole("checkbox", { name: /Changes/ }).check();
  await expect(page).toHaveURL(/show=contour,changes/);
  const told = await ask<{ features: { properties: { role: string; area: number } }[] }>(
    service(),
    "GET",
    `/v1/maps/${otherMap()}/changes?since=${roomMap()}`,
  );
  const area = told.features.reduce((sum, one) => sum + one.properties.area, 0);
  expect(new Set(told.features.map((one) => one.properties.role))).toEqual(new Set(["appeared"]));
  await expect(page.getByText(`${told.features.length} appeared, ${area.toFixed(2)} m²`)).toBeVisible();
  await expect(page.getByRole("region", { name: "Legend" })).toContainText("vanished");
  await expect.poll(() => picture(page)).not.toBe(before);
  // The other way round the wall has gone.
  await openMap(page, `?compare=${otherMap()}&show=contour,changes`);
  await expect(page.getByText(/\d+ vanished, /)).toBeVisible();
});

test("a later version leads to the one before and back, and is compared with it", async ({ page }) => {
  await openMap(page, "", laterMap());
  await expect(page.getByText("Version 2,")).toBeVisible();
  await page.getByRole("link", { name: "Compare with version 1: room" }).click();
  await expect(page.getByRole("slider", { name: "Edge between the two maps" })).toBeVisible();
  await expect(page.getByRole("checkbox", { name: /Changes/ })).toBeChecked();
  await page.getByRole("checkbox", { name: /Returns/ }).check();
  // Those of both.
  await expect(page.getByText("1,448", { exact: true })).toBeVisible();
  await page.getByRole("link", { name: "version 1: room", exact: true }).click();
  await expect(page.getByRole("heading", { level: 1 })).toHaveText("room");
  await page.getByRole("link", { name: "version 2: room, later", exact: true }).click();
  await expect(page.getByRole("heading", { level: 1 })).toHaveText("room, later");
});

test("a joined map shows where its maps lie", async ({ page }) => {
  await openMap(page, "", joinedMap());
  const frames = page.getByRole("list", { name: "Joined of" }).getByRole("listitem");
  await expect(frames).toHaveCount(2);
  await expect(frames.first()).toContainText("held");
  await expect(frames.nth(1)).toContainText("σ");
  const before = await picture(page);
  await page.getByRole("checkbox", { name: /Frames/ }).check();
  await expect.poll(() => picture(page)).not.toBe(before);
  await page.getByRole("checkbox", { name: /Returns/ }).check();
  await expect(page.getByText("1,448", { exact: true })).toBeVisible();
  await frames.nth(1).getByRole("link").click();
  await expect(page.getByRole("heading", { level: 1 })).toHaveText("room, moved");
});
