// What a job will come to before it is sent: by the service where it can tell, else the lattice alone, worked out here.

import { bytes, count, duration } from "../kit/format";
import type { Estimate, Lattice } from "../service/types";
import type { Settings, Summary } from "./reader";

/** Three cells around returns and poses, as the service does without bounds and margin. */
const MARGIN = 3;
const BORDER = 3;

export function latticeOf(summary: Summary, settings: Settings): Lattice | null {
  const { resolution } = settings.map;
  const bounds = summary.given?.map?.bounds;
  const margin = bounds ? 0 : (summary.given?.map?.margin ?? MARGIN * resolution);
  const box = bounds ? ([...bounds.min, ...bounds.max] as const) : summary.box;
  if (!box || !(resolution > 0)) return null;
  const low = (value: number) => Math.floor((value - margin) / resolution) * resolution;
  const cells = (from: number, to: number) => Math.max(1, Math.ceil((to + margin - from) / resolution - 1e-9));
  const origin: [number, number] = [low(box[0]), low(box[1])];
  const [nx, ny] = [cells(origin[0], box[2]), cells(origin[1], box[3])];
  return { origin, resolution, cells: [nx, ny], control_points: [nx + BORDER, ny + BORDER] };
}

/** In one line, with what the service said or without. */
export function sentence(lattice: Lattice | null, estimate: Estimate | null): string {
  if (!lattice) return "";
  const [nx, ny] = lattice.cells;
  const size = `${count(nx)} × ${count(ny)} cells, ${(nx * lattice.resolution).toFixed(1)} × ${(ny * lattice.resolution).toFixed(1)} m`;
  const [mx, my] = lattice.control_points;
  if (!estimate) return `About ${size}, at most ${count(mx * my)} control points.`;
  const { seconds, bytes: memory } = estimate.estimate;
  return `${size}, ${count(estimate.control_points)} control points, ${count(estimate.returns)} returns: about ${duration(seconds)} and ${bytes(memory)} of memory.`;
}
