// Where the returns of scans lie, from their poses and ranges.

import type { Point, Pose, Scan } from "../service/types";

/** Points x, y after one another, in metres relative to an origin, so that single precision is fine enough. */
export interface Returns {
  origin: Point;
  points: Float32Array;
}

/** The returns of scans; `poses`, where given, stand in for the scans' own, in their order. */
export function returnsOf(scans: readonly Scan[], poses?: readonly Pose[]): Returns {
  const first = poses?.[0] ?? scans[0]?.pose ?? { x: 0, y: 0 };
  const origin: Point = [first.x, first.y];
  const most = scans.reduce((sum, scan) => sum + scan.ranges.length, 0);
  const points = new Float32Array(2 * most);
  let count = 0;
  scans.forEach((scan, k) => {
    const { x, y, theta } = poses?.[k] ?? scan.pose;
    scan.ranges.forEach((range, beam) => {
      // A null, or a range out of bounds, is no return.
      if (range === null || !(range >= scan.range_min && range <= scan.range_max)) return;
      const bearing = theta + scan.angle_min + beam * scan.angle_increment;
      points[count] = x - origin[0] + range * Math.cos(bearing);
      points[count + 1] = y - origin[1] + range * Math.sin(bearing);
      count += 2;
    });
  });
  return { origin, points: points.slice(0, count) };
}

/** The smallest box around returns and poses; null without any. */
export function boundsOf(returns: Returns, poses: readonly Pose[]): [number, number, number, number] | null {
  const box: [number, number, number, number] = [Infinity, Infinity, -Infinity, -Infinity];
  const take = (x: number, y: number) => {
    box[0] = Math.min(box[0], x);
    box[1] = Math.min(box[1], y);
    box[2] = Math.max(box[2], x);
    box[3] = Math.max(box[3], y);
  };
  const { origin, points } = returns;
  for (let k = 0; k < points.length; k += 2)
    take(origin[0] + (points[k] as number), origin[1] + (points[k + 1] as number));
  for (const pose of poses) take(pose.x, pose.y);
  return Number.isFinite(box[0]) ? box : null;
}
