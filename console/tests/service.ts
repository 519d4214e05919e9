// A mapfit of a test's own: the real binary on a free port, with its own data.

import { type ChildProcess, execFileSync, spawn } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { createServer } from "node:net";
import { tmpdir } from "node:os";
import { join } from "node:path";

const READY_MS = 60_000;
const CONSOLE = join(import.meta.dirname, "..");

/**
 * Where a service's console is: its own, where that is console/dist. A binary that was built before is good enough to try a
 * change in, with dist served in front of it; where `CI` is set it is an error.
 */
export async function consoleOf(service: string, ends: (() => unknown)[]): Promise<string> {
  const page = await (await fetch(service)).text();
  if (page === readFileSync(join(CONSOLE, "dist/index.html"), "utf8")) return service;
  if (process.env["CI"]) throw new Error("the binary has another console than console/dist: cargo build --release");
  process.env["MAPFIT_URL"] = service;
  const { preview } = await import("vite");
  const options = { port: await freePort(), strictPort: true };
  const server = await preview({
    root: join(CONSOLE, "src"),
    configFile: join(CONSOLE, "vite.config.ts"),
    preview: options,
  });
  delete process.env["MAPFIT_URL"];
  ends.push(() => server.close());
  return (server.resolvedUrls?.local[0] ?? "").replace(/\/$/, "");
}

export function binary(): string {
  return process.env["MAPFIT_BINARY"] ?? join(import.meta.dirname, "../../target/release/mapfit");
}

export class Service {
  private child: ChildProcess | null = null;

  private constructor(
    readonly url: string,
    readonly data: string,
    private readonly options: string[],
  ) {}

  static async start(...options: string[]): Promise<Service> {
    const service = await Service.prepare(...options);
    await service.resume();
    return service;
  }

  /** Its folder and its address, not running yet. */
  static async prepare(...options: string[]): Promise<Service> {
    const data = mkdtempSync(join(tmpdir(), "mapfit-console-"));
    return new Service(`http://127.0.0.1:${await freePort()}`, data, options);
  }

  /** Starts it where it left off, at the same address. */
  async resume(): Promise<void> {
    const listen = this.url.replace("http://", "");
    const child = spawn(binary(), ["serve", "--listen", listen, "--data", this.data, ...this.options], {
      stdio: ["ignore", "ignore", "inherit"],
      env: { ...process.env, MAPFIT_LOG: "error" },
    });
    this.child = child;
    const late = Date.now() + READY_MS;
    for (;;) {
      if (await answers(`${this.url}/readyz`)) return;
      if (child.exitCode !== null || Date.now() > late) throw new Error(`${binary()} did not get ready`);
      await new Promise((resolve) => setTimeout(resolve, 100));
    }
  }

  /** Pulls its plug. */
  async kill(): Promise<void> {
    const child = this.child;
    this.child = null;
    if (!child || child.exitCode !== null) return;
    const gone = new Promise((resolve) => child.once("exit", resolve));
    child.kill("SIGKILL");
    await gone;
  }

  async end(): Promise<void> {
    await this.kill();
    rmSync(this.data, { recursive: true, force: true });
  }

  /** A key of the tenant `default`. */
  key(scopes: string): string {
    const words = ["keys", "create", "--data", this.data, "--scopes", scopes];
    return execFileSync(binary(), words, { encoding: "utf8" }).trim().split("\n").at(-1) as string;
  }
}

async function answers(url: string): Promise<boolean> {
  return fetch(url).then(
    (answer) => answer.ok,
    () => false,
  );
}

function freePort(): Promise<number> {
  return new Promise((resolve) => {
    const server = createServer().listen(0, "127.0.0.1", () => {
      const address = server.address();
      server.close(() => resolve(typeof address === "object" && address ? address.port : 0));
    });
  });
}
