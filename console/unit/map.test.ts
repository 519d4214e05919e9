import { paddingBeside } from "../src/map/canvas";
import { describe, expect, test } from "vitest";
import { ticksOf } from "../src/map/legend";
import { linesOf } from "../src/map/overlays/geometry";
import { ellipseOf } from "../src/map/overlays/poses";
import { round, scalesIn } from "../src/map/scale";
import { extentOf, rowUpwards, tileGrid } from "../src/map/space";
import { tilePath } from "../src/service/maps";

describe("tiles", () => {
  test("have sides of 1024 / 2^z metres from the origin, rows upwards, negative ones too", () => {
    const grid = tileGrid([-100, -100, 100, 100]);
    for (const [z, side] of [
      [0, 1024],
      [4, 64],
      [14, 0.0625],
    ] as const) {
      const [, x, row] = grid.getTileCoordForCoordAndZ([side * 2.5, -side * 1.5], z);
      expect([x, rowUpwards(row ?? 0)]).toEqual([2, -2]);
      expect(grid.getTileCoordExtent([z, 2, row ?? 0])).toEqual([2 * side, -2 * side, 3 * side, -side]);
    }
  });

  test("are named as the service names them; occupancy has no end of the scale", () => {
    const style = { layer: "sigma", kind: "posterior", theme: "dark", max: 0.05 } as const;
    expect(tilePath("id", style, 3, -1, 2)).toBe("/v1/maps/id/tiles/sigma/3/-1/2?kind=posterior&theme=dark&max=0.05");
    expect(tilePath("id", { ...style, layer: "occupancy" }, 0, 0, 0)).toBe(
      "/v1/maps/id/tiles/occupancy/0/0/0?kind=posterior&theme=dark",
    );
  });
});

test("a lattice's extent is that of its cells", () => {
  expect(extentOf({ origin: [-1, 2], resolution: 0.5, cells: [4, 6], control_points: [7, 9] })).toEqual([-1, 2, 1, 5]);
});

test("scales end at round numbers", () => {
  expect([0.0137, 0.1, 1.0, 1.1, 99, 100, 0].map((value) => round(value))).toEqual([0.02, 0.1, 1, 2, 100, 100, 1]);
});

test("scales are chosen from what was seen", () => {
  const answers = {
    kind: "propagated" as const,
    distance: [-3, 0.5, null, 99],
    sigma: [0.01, 0.02, null, 9],
    observed: [true, true, false, false],
  };
  expect(scalesIn(answers)).toMatchObject({ distance: 3, sigma: 0.02 });
});

test("a legend's ticks have units, and a sign where distances have", () => {
  expect(ticksOf({ layer: "sigma", distance: "vdf", max: 0.05 })).toEqual(["0", "25", "≥ 50 mm"]);
  expect(ticksOf({ layer: "distance", distance: "sdf", max: 2 })).toEqual(["\u22122 free", "0", "≥ 2 m beyond"]);
});

test("an ellipse has the covariance's axes", () => {
  const { major, minor, turn } = ellipseOf([2.5, 1.5, 0, 1.5, 2.5, 0, 0, 0, 1]);
  expect([major, minor, turn]).toEqual([2, 1, Math.PI / 4]);
});

test("polygons are rings, holes included", () => {
  const ring = [
    [0, 0],
    [1, 0],
    [1, 1],
  ];
  expect(linesOf({ type: "MultiPolygon", coordinates: [[ring, ring], [ring]] })).toHaveLength(3);
  expect(linesOf({ type: "Point", coordinates: [0, 0] })).toEqual([]);
});

test("a map is fitted beside the legend where it would lie under it, unless it got much smaller", () => {
  const plain = [24, 24, 24, 24];
  const legend = [240, 140];
  // Wide: the legend lies above it. Tall: beside it. Nearly square: below the legend.
  expect(paddingBeside(legend, [900, 750], [80, 20])).toEqual(plain);
  expect(paddingBeside(legend, [900, 750], [20, 80])).toEqual(plain);
  expect(paddingBeside(legend, [900, 750], [8, 6])).toEqual([164, 24, 24, 24]);
  expect(paddingBeside(legend, [1400, 750], [10, 7])).toEqual([24, 264, 24, 24]);
  expect(paddingBeside([0, 0], [390, 500], [8, 6])).toEqual(plain);
  expect(paddingBeside([300, 400], [400, 500], [8, 8])).toEqual(plain);
});
