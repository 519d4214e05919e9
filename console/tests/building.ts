// A building of rooms behind each other, large enough that its map has a hundred thousand control points in use. Each room is
// seen once and poses are taken as they are: what a map takes to look at is its size, not how well it was surveyed.

import { room } from "./room";

const ACROSS = 10;
const UP = 8;
/** From one room's corner to the next: the room, and a wall. */
const PITCH = [6.3, 4.3] as const;
const BEAMS = 361;

export const POSES = ACROSS * UP;
export const RETURNS = POSES * BEAMS;

/**
 * Signed it fits in some ten seconds, since one step is enough for a picture. A vector map, which needs one step and no more,
 * takes minutes and 5 GB for its covariance.
 */
export function building(distance: "sdf" | "vdf") {
  const one = room({ name: `building, ${distance}`, scans: 1, beams: BEAMS, resolution: 0.15 });
  const scans = Array.from({ length: POSES }, (_, k) => {
    const [column, row] = [k % ACROSS, Math.floor(k / ACROSS)];
    return one.scans.map(({ pose, ...scan }) => ({
      ...scan,
      pose: { ...pose, x: pose.x + column * PITCH[0], y: pose.y + row * PITCH[1] },
    }));
  }).flat();
  return { ...one, scans, map: { ...one.map, distance }, fit: { poses: "fixed", max_iterations: 1 } };
}
