// What every test of the console begins with.

import { readFileSync } from "node:fs";
import { join } from "node:path";
import { type Locator, type Page, test as base, expect } from "@playwright/test";
import { ask } from "./api";

export { expect };

export const test = base.extend<{ failures: string[] }>({
  baseURL: async ({}, use) => use(process.env["CONSOLE"]),
  // A page that broke its content security policy or threw is no green test.
  failures: [
    async ({ page }, use) => {
      const failures: string[] = [];
      page.on("pageerror", (error) => failures.push(error.message));
      page.on("console", (message) => {
        if (/content security policy/i.test(message.text())) failures.push(message.text());
      });
      await use(failures);
      expect(failures).toEqual([]);
    },
    { auto: true },
  ],
});

export const service = () => process.env["SERVICE"] as string;
export const roomMap = () => process.env["ROOM_MAP"] as string;
/** The same room as a vector map. */
export const vectorMap = () => process.env["VECTOR_MAP"] as string;
/** The same room with a piece of wall in its middle. */
export const otherMap = () => process.env["OTHER_MAP"] as string;
/** The room's next version. */
export const laterMap = () => process.env["LATER_MAP"] as string;
/** The room and the other, joined. */
export const joinedMap = () => process.env["JOINED_MAP"] as string;

/** Opens an address, as a new page would. */
export async function open(page: Page, address: string, console = ""): Promise<void> {
  await page.goto(`${console}/${address}`);
  await page.reload();
}

/** Opens a map and waits for its colours. */
export async function openMap(page: Page, query = "", id = roomMap()): Promise<void> {
  await open(page, `#/maps/${id}${query}`);
  await drawn(page);
}

/** Waits until every tile of the view is there. */
export async function drawn(page: Page): Promise<void> {
  await expect(page.locator(".map-view")).toHaveAttribute("data-tiles", "0");
}

/** The map's pixels, as a hash, once they do not change any more. */
export async function picture(page: Page): Promise<string> {
  let before = "";
  for (;;) {
    await drawn(page);
    const now = await page.evaluate(async () => {
      await new Promise((resolve) => requestAnimationFrame(() => setTimeout(resolve, 150)));
      const canvases = [...document.querySelectorAll<HTMLCanvasElement>(".map canvas")];
      const pixels = new TextEncoder().encode(canvases.map((canvas) => canvas.toDataURL()).join());
      return new Uint8Array(await crypto.subtle.digest("SHA-256", pixels)).join();
    });
    if (now === before) return now;
    before = now;
  }
}

/** A recording that the service's own tests read, too. */
export const recording = (name: string) => readFileSync(join(import.meta.dirname, "../../tests/fixtures", name));

export async function submit(job: object): Promise<string> {
  return (await ask<{ id: string }>(service(), "POST", "/v1/jobs", job)).id;
}

/** Drops a file on the page, which has to be one that takes files. */
export async function drop(page: Page, name: string, content: string | Buffer): Promise<void> {
  await page.locator(".drop").waitFor();
  await page.evaluate(
    ([name, base64]) => {
      const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
      const dataTransfer = new DataTransfer();
      dataTransfer.items.add(new File([bytes], name));
      document.body.dispatchEvent(new DragEvent("drop", { bubbles: true, cancelable: true, dataTransfer }));
    },
    [name, Buffer.from(content).toString("base64")] as const,
  );
}

/** Goes to an element by the Tab key alone, as someone without a mouse does. */
export async function tabTo(page: Page, wanted: Locator): Promise<void> {
  await wanted.waitFor({ state: "attached" });
  const there = () => wanted.evaluate((element) => element === document.activeElement);
  for (let presses = 0; presses < 150; presses += 1) {
    if (await there()) return;
    await page.keyboard.press("Tab");
  }
  throw new Error(`the Tab key does not lead to ${wanted}`);
}
