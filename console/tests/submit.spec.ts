import { readFileSync } from "node:fs";
import { join } from "node:path";
import { gzipSync } from "node:zlib";
import type { Page } from "@playwright/test";
import { ask } from "./api";
import { drop, expect, open, recording, service, test } from "./fixtures";
import { carmen, room } from "./room";

/** How many pixels of the preview have ink, within the lattice's frame. */
const inked = (page: Page) =>
  page.locator(".preview canvas").evaluateAll((canvases) =>
    (canvases as HTMLCanvasElement[]).reduce((sum, canvas) => {
      const [width, height] = [0.4 * canvas.width, 0.7 * canvas.height];
      const { data } = canvas.getContext("2d")!.getImageData(0.3 * canvas.width, 0.15 * canvas.height, width, height);
      return sum + data.filter((value, at) => at % 4 === 3 && value > 0).length;
    }, 0),
  );

/** The jobs there are. */
const count = async () => (await ask<{ items: object[] }>(service(), "GET", "/v1/jobs?limit=1000")).items.length;

test("a job is dropped, drawn, sent and watched to its map", async ({ page }) => {
  // As where the console came by plain HTTP from another machine: this one is trusted by its name.
  await page.addInitScript(() => void Reflect.deleteProperty(Crypto.prototype, "randomUUID"));
  await open(page, "#/submit");
  await drop(page, "lab.json", JSON.stringify(room({ name: "dropped" })));
  await expect(page.getByText("lab.json: 4 scans, 724 returns")).toBeVisible();
  await expect(page.locator(".preview canvas").first()).toBeVisible();
  await expect(page.getByLabel("Name")).toHaveValue("dropped");
  await expect(page.getByRole("radio", { name: /Room/ })).toBeChecked();
  await expect(page.locator(".forecast")).toContainText("control points");
  // Asking what it will take must never run it.
  const before = await count();
  const asked = page.waitForResponse(/dry_run=true/);
  await page.getByLabel("Resolution, m").fill("0.3");
  expect((await asked).status()).toBe(200);
  await expect(page.locator(".forecast")).toContainText("of memory");
  expect(await count()).toBe(before);
  await page.getByRole("button", { name: "Submit" }).click();
  await expect(page.getByRole("heading", { level: 1 })).toHaveText("dropped");
  await page.getByRole("link", { name: /Open map/ }).click();
  await expect(page.getByRole("region", { name: "Legend" })).toBeVisible();
});

test("a CARMEN log, gzipped, becomes a vector map; some of its scans are taken", async ({ page }) => {
  await open(page, "#/submit");
  await drop(page, "walk.log.gz", gzipSync(carmen(12)));
  await expect(page.getByText("walk.log.gz: 12 scans, 1,944 returns")).toBeVisible();
  await expect(page.getByRole("radio", { name: /Building/ })).toBeChecked();
  await page.getByLabel("Every so many scans").fill("2");
  await expect(page.getByText("walk.log.gz: 6 scans of 12, 972 returns")).toBeVisible();
  await page.getByRole("button", { name: "Submit" }).click();
  await expect(page.locator(".chip")).toHaveText("done");
});

test("an MCAP recording is tried out, sent as it is, and becomes a map", async ({ page }) => {
  await open(page, "#/submit");
  await drop(page, "drive.mcap", recording("drive-zstd.mcap"));
  await expect(page.getByText("drive.mcap: 2 scans, 362 returns")).toBeVisible();
  await expect(page.locator(".forecast")).toContainText("476 control points");
  // Its scans are the service's to read; what it has read is drawn, in its lattice.
  await expect(page.getByRole("application", { name: /lattice to be laid/ })).toBeVisible();
  await expect(page.getByText("the points are what it read there")).toBeVisible();
  await expect.poll(() => inked(page)).toBeGreaterThan(100);
  await page.getByLabel("Every so many scans").fill("2");
  await expect(page.getByText("drive.mcap: 1 scan, 181 returns")).toBeVisible();
  await page.getByLabel("Every so many scans").fill("1");
  await page.getByLabel("Name").fill("driven");
  const sent = page.waitForRequest((request) => request.method() === "POST" && request.url().endsWith("/v1/jobs"));
  await page.getByRole("button", { name: "Submit" }).click();
  expect((await sent).headers()["content-type"]).toContain("multipart/form-data");
  await expect(page.getByRole("heading", { level: 1 })).toHaveText("driven");
  await page.getByRole("link", { name: /Open map/ }).click();
  await page.getByRole("checkbox", { name: /Returns/ }).check();
  await expect(page.getByText("362", { exact: true })).toBeVisible();
});

test("a recording that cannot be read is answered with what is wrong, at the field where that can be mended", async ({
  page,
}) => {
  await open(page, "#/submit");
  await drop(page, "drive.mcap", recording("drive-zstd.mcap"));
  await page.getByLabel("Scan topic").fill("/nowhere");
  await page.getByRole("button", { name: "Submit" }).click();
  await expect(page.getByLabel("Scan topic")).toHaveAttribute("aria-invalid", "true");
  await drop(page, "torn.mcap", recording("drive-zstd.mcap").subarray(0, 900));
  await page.getByRole("button", { name: "Submit" }).click();
  await expect(page.getByRole("alert").filter({ hasText: "/recording" })).toBeVisible();
});

test("a real log is read as the command line reads it", async ({ page }) => {
  const recordings = process.env["MAPFIT_RECORDINGS"];
  test.skip(!recordings, "MAPFIT_RECORDINGS is not set");
  const log = join(recordings ?? "", "seattle.flaser.log.gz");
  await open(page, "#/submit");
  await drop(page, "seattle.log.gz", readFileSync(log));
  await expect(page.getByText("seattle.log.gz: 241 scans, 86,294 returns")).toBeVisible();
});

test("a fault of the service stands at its field", async ({ page }) => {
  await open(page, "#/submit");
  await drop(page, "lab.json", JSON.stringify(room({ name: "too fine" })));
  await page.getByLabel("Resolution, m").fill("0.0004");
  await page.getByRole("button", { name: "Submit" }).click();
  await expect(page.getByLabel("Resolution, m")).toHaveAttribute("aria-invalid", "true");
});

for (const [name, content, words] of [
  ["empty.json", "", "The file is empty"],
  ["odd.json", "{", "not JSON"],
  ["other.json", "{}", "no scans"],
  ["words.log", "ODOM 1 2 3\n", "no FLASER line"],
  ["torn.log", "FLASER 180 1 2 3\n", "Line 1: the line ends before its range"],
  ["drive.bag", "#ROSBAG V2.0\n", "rosbags-convert --src OLD.bag --dst NEW --dst-storage mcap"],
  ["drive.db3", "SQLite format 3\u0000", "rosbags-convert --src FOLDER --dst NEW --dst-storage mcap"],
  ["map.pgm", "P5\n1 1\n255\n", "occupancy map"],
  ["damaged.log.gz", "\u001f\u008bnothing", "damaged"],
] as const) {
  test(`${name} is refused with what to do`, async ({ page }) => {
    await open(page, "#/submit");
    await drop(page, name, Buffer.from(content, "latin1"));
    await expect(page.getByRole("alert").filter({ hasText: "cannot be sent" })).toContainText(words);
  });
}

test("a file that is too large is refused before it is read", async ({ page }) => {
  await open(page, "#/submit");
  await page.locator(".drop").waitFor();
  await page.evaluate(() => {
    const dataTransfer = new DataTransfer();
    dataTransfer.items.add(new File([new Uint8Array(70 * 1024 ** 2)], "huge.json"));
    document.body.dispatchEvent(new DragEvent("drop", { bubbles: true, cancelable: true, dataTransfer }));
  });
  await expect(page.getByRole("alert").filter({ hasText: "cannot be sent" })).toContainText("64.0 MiB is the limit");
});
