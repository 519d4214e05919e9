// Starts what the tests need: a service with its own data, and in front of it the built console where the service does not
// bring it itself. Fills it with maps and jobs once.

import { spawn } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { createServer } from "node:net";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { room } from "./room";

const ROOT = join(import.meta.dirname, "..");

export default async function setup(): Promise<() => Promise<void>> {
  const ends: (() => void | Promise<void>)[] = [];
  const service = process.env["MAPFIT_URL"] ?? (await start(ends));
  process.env["SERVICE"] = service;
  const page = await (await fetch(service)).text();
  process.env["CONSOLE"] = page.includes("assets/index-") ? service : await serveDist(service, ends);
  process.env["ROOM_MAP"] = await fit(service, room({ name: "room", labels: { site: "test" } }));
  process.env["OTHER_MAP"] = await fit(service, room({ name: "room, moved", door: true, labels: { site: "test" } }));
  return async () => {
    for (const end of ends.reverse()) await end();
  };
}

async function start(ends: (() => void)[]): Promise<string> {
  const binary = process.env["MAPFIT_BINARY"] ?? join(ROOT, "../target/release/mapfit");
  const data = mkdtempSync(join(tmpdir(), "mapfit-console-"));
  const port = await freePort();
  const child = spawn(binary, ["serve", "--listen", `127.0.0.1:${port}`, "--data", data, "--workers", "1"], {
    stdio: "ignore",
  });
  ends.push(() => {
    child.kill();
    rmSync(data, { recursive: true, force: true });
  });
  const url = `http://127.0.0.1:${port}`;
  for (let attempt = 0; attempt < 100; attempt += 1) {
    if (
      await fetch(`${url}/readyz`).then(
        (answer) => answer.ok,
        () => false,
      )
    )
      return url;
    await new Promise((resolve) => setTimeout(resolve, 100));
  }
  throw new Error(`${binary} did not get ready; set MAPFIT_BINARY or MAPFIT_URL`);
}

async function serveDist(service: string, ends: (() => void | Promise<void>)[]): Promise<string> {
  process.env["MAPFIT_URL"] = service;
  const { preview } = await import("vite");
  const server = await preview({
    root: join(ROOT, "src"),
    configFile: join(ROOT, "vite.config.ts"),
    preview: { port: await freePort(), strictPort: true },
  });
  ends.push(() => server.close());
  return (server.resolvedUrls?.local[0] ?? "").replace(/\/$/, "");
}

/** A job's map, once it is there. */
async function fit(service: string, job: object): Promise<string> {
  const init = { method: "POST", body: JSON.stringify(job), headers: { "content-type": "application/json" } };
  const { id } = (await (await fetch(`${service}/v1/jobs`, init)).json()) as { id: string };
  const done = (await (await fetch(`${service}/v1/jobs/${id}?wait=60`)).json()) as {
    map_id: string | null;
    problem: unknown;
  };
  if (!done.map_id) throw new Error(`the example made no map: ${JSON.stringify(done.problem)}`);
  return done.map_id;
}

function freePort(): Promise<number> {
  return new Promise((resolve) => {
    const server = createServer().listen(0, "127.0.0.1", () => {
      const address = server.address();
      server.close(() => resolve(typeof address === "object" && address ? address.port : 0));
    });
  });
}
