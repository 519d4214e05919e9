// Builds `src` into `dist`, which the binary embeds; serves either for development, before a running mapfit.

import type { HttpProxy } from "vite";
import { defineConfig } from "vitest/config";
import { standInTiles } from "./tools/stand-in-tiles.ts";
import { policy } from "./tools/policy.ts";

const service = process.env["MAPFIT_URL"] ?? "http://127.0.0.1:8080";
// `/` and `/assets` are ours; everything else a page may ask for is the service's.
const proxy = Object.fromEntries(
  ["/v1", "/docs", "/openapi.json", "/readyz"].map((path) => [path, { target: service, configure: endWithService }]),
);

/** A stream that the service breaks off ends here, too, as it does without anything in between. */
function endWithService(proxy: HttpProxy.ProxyServer): void {
  proxy.on("proxyRes", (answer, _request, response) => {
    answer.on("close", () => answer.complete || response.destroy());
  });
}

export default defineConfig({
  root: "src",
  base: "./",
  plugins: [standInTiles(service)],
  server: { host: "127.0.0.1", proxy },
  preview: { host: "127.0.0.1", proxy, headers: { "content-security-policy": policy } },
  worker: { format: "es" },
  build: {
    outDir: "../dist",
    emptyOutDir: true,
    target: "es2022",
    // Everything is a file: the content security policy has no `data:` for scripts, styles or workers.
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    license: { fileName: "licenses.md" },
    rolldownOptions: { output: { codeSplitting: { groups: [{ name: "openlayers", test: /node_modules\/ol\// }] } } },
  },
  test: { root: ".", include: ["unit/**/*.test.ts"] },
});
