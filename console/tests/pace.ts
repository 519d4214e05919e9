// How long a page is held up, and how fast the machine is that it is measured on.

import { type Page } from "@playwright/test";

interface Watched {
  longest: number;
}

/** Counts the page's long tasks from its next load on. */
export async function watchTasks(page: Page): Promise<void> {
  await page.addInitScript(() => {
    const watched = window as unknown as Watched;
    watched.longest = 0;
    new PerformanceObserver((list) =>
      list.getEntries().forEach((entry) => (watched.longest = Math.max(watched.longest, entry.duration))),
    ).observe({ type: "longtask" });
  });
}

/** The longest task since it was last asked, milliseconds; 0 where none took longer than 50. */
export function longestTask(page: Page): Promise<number> {
  return page.evaluate(() => {
    const watched = window as unknown as Watched;
    const { longest } = watched;
    watched.longest = 0;
    return longest;
  });
}

/** What a piece of work takes on the machine that the bars were set on, when it is idle: milliseconds. */
const WORK_MS = 55;

/** How many times slower the page runs than on that machine; never less than 1. */
export async function slowness(page: Page): Promise<number> {
  const taken = await page.evaluate(() => {
    const times = Array.from({ length: 9 }, () => {
      const began = performance.now();
      let sum = 0;
      for (let k = 1; k < 5e5; k += 1) sum += Math.sin(k) / k;
      return sum > 0 ? performance.now() - began : Infinity;
    });
    return times.sort((a, b) => a - b)[4] as number;
  });
  return Math.max(1, taken / WORK_MS);
}
