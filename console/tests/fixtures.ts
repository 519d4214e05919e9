// What every test of the console begins with.

import { type Page, test as base, expect } from "@playwright/test";

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
export const otherMap = () => process.env["OTHER_MAP"] as string;

/** Whether the service has a route. */
export async function knows(path: string): Promise<boolean> {
  const document = (await (await fetch(`${service()}/openapi.json`)).json()) as { paths: object };
  return path in document.paths;
}

/** Opens an address, as a new page would. */
export async function open(page: Page, address: string): Promise<void> {
  await page.goto(`/${address}`);
  await page.reload();
}

/** Opens a map and waits for its colours. */
export async function openMap(page: Page, query = ""): Promise<void> {
  const tile = page.waitForResponse((response) => response.url().includes("/tiles/") && response.ok());
  await open(page, `#/maps/${roomMap()}${query}`);
  await tile;
}

export async function submit(job: object): Promise<string> {
  const init = { method: "POST", body: JSON.stringify(job), headers: { "content-type": "application/json" } };
  const answer = (await (await fetch(`${service()}/v1/jobs`, init)).json()) as { id: string };
  return answer.id;
}

export async function drop(page: Page, name: string, content: string | Buffer): Promise<void> {
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
