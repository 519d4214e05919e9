// What all tests share: a service with maps in it, among them, where the recordings are there, a real building's. Its fit takes a
// minute, so it begins here and the test that needs it comes last.

import { readFileSync } from "node:fs";
import { join, resolve } from "node:path";
import { gunzipSync } from "node:zlib";
import { parseCarmen } from "../src/scan/carmen";
import { ask, finished } from "./api";
import { room } from "./room";
import { Service, consoleOf } from "./service";

const REPOSITORY = join(import.meta.dirname, "../..");

export default async function setup(): Promise<() => Promise<void>> {
  const own = process.env["MAPFIT_URL"] ? null : await Service.start("--workers", "2");
  const ends: (() => unknown)[] = [() => own?.end()];
  const end = async () => {
    for (const one of ends.reverse()) await one();
  };
  try {
    const service = process.env["MAPFIT_URL"] ?? (own as Service).url;
    process.env["SERVICE"] = service;
    process.env["CONSOLE"] = await consoleOf(service, ends);
    process.env["INTEL_JOB"] = await intel(service);
    const labels = { site: "test" };
    const bare = await submit(service, room({ name: "room", labels }));
    const door = await submit(service, room({ name: "room, moved", door: true, labels }));
    const walls = { ...room({ name: "walls" }), map: { distance: "vdf", resolution: 0.25 } };
    const vector = await submit(service, walls);
    process.env["ROOM_MAP"] = await finished(service, bare);
    process.env["OTHER_MAP"] = await finished(service, door);
    process.env["VECTOR_MAP"] = await finished(service, vector);
    Object.assign(process.env, await grown(service, process.env["ROOM_MAP"], process.env["OTHER_MAP"]));
  } catch (error) {
    await end();
    throw error;
  }
  return end;
}

/** A later version of a map, and two maps joined. */
async function grown(service: string, map: string, other: string): Promise<Record<string, string>> {
  const { scans, noise } = room({ name: "", door: true });
  const update = { name: "room, later", scans, noise };
  const guess = { x: 0.05, y: 0, theta: 0 };
  const join = { name: "joined", maps: [{ id: map }, { id: other, pose: guess }], map: { resolution: 0.25 } };
  const [later, joined] = await Promise.all([
    ask<{ id: string }>(service, "POST", `/v1/maps/${map}/updates`, update),
    ask<{ id: string }>(service, "POST", "/v1/joins", join),
  ]);
  return { LATER_MAP: await finished(service, later.id), JOINED_MAP: await finished(service, joined.id) };
}

async function submit(service: string, job: object): Promise<string> {
  return (await ask<{ id: string }>(service, "POST", "/v1/jobs", job)).id;
}

/** The job of the Intel log; empty without recordings, which CI has. */
async function intel(service: string): Promise<string> {
  const recordings = process.env["MAPFIT_RECORDINGS"];
  if (!recordings) {
    if (process.env["CI"]) throw new Error("MAPFIT_RECORDINGS does not say where the recordings are");
    return "";
  }
  // Relative to the repository, as for the service's own tests.
  process.env["MAPFIT_RECORDINGS"] = resolve(REPOSITORY, recordings);
  const scans = parseCarmen(
    gunzipSync(readFileSync(resolve(REPOSITORY, recordings, "intel.flaser.log.gz"))).toString(),
  );
  const noise = { sigma_x: 0.02, sigma_y: 0.02, sigma_theta: 0.005, sigma_range: 0.02 };
  return submit(service, { name: "intel", scans, noise, map: { distance: "vdf", resolution: 0.25 } });
}
