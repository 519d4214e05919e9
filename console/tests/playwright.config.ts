// The console in a browser, before the real binary: `MAPFIT_BINARY`, or what `cargo build --release` made. `MAPFIT_URL`
// names a service that runs already.

import { existsSync } from "node:fs";
import { defineConfig } from "@playwright/test";

const browsers = [process.env["CHROMIUM"], "/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"];

export default defineConfig({
  testDir: ".",
  outputDir: "results",
  // Machines that test are slow and busy: what is awaited has time to come, and nothing is tried twice.
  timeout: 120_000,
  expect: { timeout: 30_000 },
  retries: 0,
  // Two browsers, each with files of its own; what is timed has the machine to itself, when all else is done.
  workers: 2,
  fullyParallel: false,
  forbidOnly: Boolean(process.env["CI"]),
  reporter: [["list"]],
  globalSetup: "./setup.ts",
  projects: [
    { name: "console", testIgnore: ["many.spec.ts", "pace.spec.ts"] },
    { name: "many", testMatch: "many.spec.ts", dependencies: ["console"] },
    // Waits for a building's fit, which runs beside the others.
    { name: "pace", testMatch: "pace.spec.ts", dependencies: ["many"] },
  ],
  use: {
    launchOptions: {
      executablePath: browsers.find((path) => path && existsSync(path)) ?? "chromium",
      // Root may not have Chromium's sandbox, containers hardly any /dev/shm, and neither a GPU.
      args: ["--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu"],
    },
    viewport: { width: 1280, height: 800 },
    // Nothing fades in or glides: what is looked at is there.
    contextOptions: { reducedMotion: "reduce" },
    screenshot: "only-on-failure",
  },
});
