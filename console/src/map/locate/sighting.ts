// What is asked of the service about scans, a few at a time: answers come in as they are found, and can be stopped.

import type { Sighting } from "../../service/maps";
import type { Kind, LocatedScan, Noise } from "../../service/types";
import type { FreeScan, Picked } from "./scans";

export interface Prior {
  /** Standard deviations of the file's poses, metres and radians; null: scans may be anywhere. */
  sigma: { position: number; heading: number } | null;
}

export interface Located {
  index: number;
  scan: FreeScan;
  found: LocatedScan;
}

/** Without a prior the whole map is searched: about a second a scan. */
const TOGETHER = { near: 5, anywhere: 1 };
const HYPOTHESES = 3;
const RANGE_NOISE = 0.02;

/** The requests that ask for all scans, each with the indices it asks for. */
export function sightings({ scans, indices, noise }: Picked, { sigma }: Prior, kind: Kind) {
  const together = sigma ? TOGETHER.near : TOGETHER.anywhere;
  const asked = scans.map((scan) => asSighted(scan, sigma !== null));
  const starts = Array.from({ length: Math.ceil(scans.length / together) }, (_, k) => k * together);
  return starts.map((start) => ({
    indices: indices.slice(start, start + together),
    scans: scans.slice(start, start + together),
    sighting: {
      scans: asked.slice(start, start + together),
      noise: noiseOf(noise, sigma),
      kind,
      hypotheses: sigma ? 1 : HYPOTHESES,
    } satisfies Sighting,
  }));
}

/** The panel's sigmas stand for what the file says of its poses. */
function asSighted(scan: FreeScan, near: boolean): FreeScan {
  const { pose, angle_min, angle_increment, range_min, range_max, ranges } = scan;
  return { pose: near ? pose : null, angle_min, angle_increment, range_min, range_max, ranges };
}

function noiseOf(noise: Noise | null, sigma: Prior["sigma"]): Noise {
  const { position, heading } = sigma ?? { position: 1, heading: 1 };
  return { sigma_x: position, sigma_y: position, sigma_theta: heading, sigma_range: noise?.sigma_range ?? RANGE_NOISE };
}
