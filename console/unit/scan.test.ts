import { expect, test } from "vitest";
import { boundsOf, returnsOf } from "../src/scan/returns";
import type { Scan } from "../src/service/types";

const scan: Scan = {
  pose: { x: 100_000, y: 2, theta: Math.PI / 2 },
  angle_min: -Math.PI / 2,
  angle_increment: Math.PI / 2,
  range_min: 0.1,
  range_max: 5,
  ranges: [1, 2, null, 7, 0.01],
};

test("returns lie where pose, bearing and range say; what is no return is left out", () => {
  const { origin, points } = returnsOf([scan]);
  expect(origin).toEqual([100_000, 2]);
  [1, 0, 0, 2].forEach((value, k) => expect(points[k]).toBeCloseTo(value, 6));
  expect(points).toHaveLength(4);
});

test("fitted poses stand in for the scans' own", () => {
  const { origin, points } = returnsOf([scan], [{ x: 1, y: 1, theta: 0 }]);
  expect(origin).toEqual([1, 1]);
  [0, -1, 2, 0].forEach((value, k) => expect(points[k]).toBeCloseTo(value, 6));
});

test("bounds hold returns and poses; there are none of nothing", () => {
  const [x0, y0, x1, y1] = boundsOf(returnsOf([scan]), [scan.pose]) ?? [];
  expect([x0, y0]).toEqual([100_000, 2]);
  expect(x1).toBeCloseTo(100_001, 5);
  expect(y1).toBeCloseTo(4, 5);
  expect(boundsOf({ origin: [0, 0], points: new Float32Array() }, [])).toBeNull();
});
