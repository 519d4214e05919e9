// The console in a browser, before a real service. `MAPFIT_URL` names a running one; else `MAPFIT_BINARY` is started.

import { existsSync } from "node:fs";
import { defineConfig } from "@playwright/test";

const browsers = [process.env["CHROMIUM"], "/usr/bin/chromium", "/usr/bin/chromium-browser", "/usr/bin/google-chrome"];

export default defineConfig({
  testDir: ".",
  outputDir: "results",
  timeout: 60_000,
  // Jobs take turns at the service's workers.
  workers: 1,
  fullyParallel: false,
  forbidOnly: Boolean(process.env["CI"]),
  reporter: [["list"]],
  globalSetup: "./setup.ts",
  use: {
    launchOptions: {
      executablePath: browsers.find((path) => path && existsSync(path)) ?? "chromium",
      args: ["--no-sandbox"],
    },
    viewport: { width: 1280, height: 800 },
    trace: "retain-on-failure",
  },
});
