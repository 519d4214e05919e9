// Where colours end: at the 98th percentile of what was seen, made round. One value a layer, whatever the view, so that
// panning never changes what a colour means.

import type { Extent } from "ol/extent";
import { type Layer, queryMap } from "../service/maps";
import type { Answers, Kind } from "../service/types";
import { gridOver } from "./space";

export type Scales = Record<Layer, number>;

const SIDE = 40;
const SHARE = 0.98;

export async function scalesOf(id: string, extent: Extent, kind: Kind, signal: AbortSignal): Promise<Scales> {
  const fields = ["distance", "sigma", "clearance", "observed"];
  return scalesIn(await queryMap(id, gridOver(extent, SIDE), kind, fields, signal));
}

export function scalesIn(answers: Answers): Scales {
  const end = (values: (number | null)[] = []) => {
    const seen = values.filter((value, k): value is number => value !== null && answers.observed?.[k] === true);
    const sizes = seen.map(Math.abs).sort((a, b) => a - b);
    return round(sizes[Math.floor(sizes.length * SHARE)] ?? sizes.at(-1) ?? 1, [1, 1.5, 2, 3, 5, 7.5]);
  };
  return {
    distance: end(answers.distance),
    sigma: end(answers.sigma),
    clearance: end(answers.clearance),
    occupancy: 100,
  };
}

/** The next of these steps times a power of ten. */
export function round(value: number, steps: number[] = [1, 2, 5]): number {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value) + 1e-9);
  const step = steps.find((step) => step * power >= value * (1 - 1e-9)) ?? 10;
  return Number((step * power).toPrecision(3));
}
