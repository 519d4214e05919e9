// Every download of a map, by its link and by the lines to copy.

import { execFile } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, statSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { promisify } from "node:util";
import { expect, joinedMap, openMap, roomMap, test } from "./fixtures";

const run = promisify(execFile);

/** How files of a kind begin. */
const BEGINS: Record<string, string[]> = {
  npz: ["PK"],
  zip: ["PK"],
  png: ["\u0089PNG"],
  tif: ["II*", "MM"],
  svg: ["<svg"],
  json: ["{"],
  geojson: ["{"],
  mcap: ["\u0089MCAP0"],
};

test("every download answers, by its link and by the lines to copy", async ({ page }) => {
  // A joined map beside another has all there are.
  await openMap(page, `?compare=${roomMap()}`, joinedMap());
  await expect(page.getByRole("list", { name: "Joined of" })).toBeVisible();
  const links = page.locator(".downloads li");
  const folder = mkdtempSync(join(tmpdir(), "mapfit-lines-"));
  const names: string[] = [];
  for (const link of await links.all()) {
    const begun = page.waitForEvent("download");
    await link.locator("a").click();
    const download = await begun;
    const name = download.suggestedFilename();
    names.push(name);
    const file = readFileSync(await download.path());
    const begins = BEGINS[name.split(".").at(-1) ?? ""] ?? [];
    expect(begins, name).toContainEqual(file.toString("latin1", 0, Math.max(...begins.map((text) => text.length))));
    await link.locator("summary").click();
    for (const [k, program] of (["bash", "python3"] as const).entries()) {
      const line = await link.locator(".copyable code").nth(k).innerText();
      // The service is on this machine, whatever proxy leads out of it.
      await run(program, ["-c", line], { cwd: folder, env: { ...process.env, no_proxy: "127.0.0.1" } });
      expect(statSync(join(folder, name)).size, `${program}: ${line}`).toBe(file.length);
      rmSync(join(folder, name));
    }
    await link.locator("summary").click();
  }
  rmSync(folder, { recursive: true });
  const kinds =
    "grid.npz grid.tif nav2.zip nav2-scale.zip nav2-raw.zip map.mcap poses.json frames.json changes.geojson";
  for (const end of kinds.split(" ")) expect(names).toContain(`joined-${end}`);
  expect(new Set(names).size, "no two files have one name").toBe(names.length);
});
