// The map's frame for OpenLayers: plain metres, y upwards, no globe.

import { type Extent, getBottomLeft, getTopRight } from "ol/extent";
import Projection from "ol/proj/Projection";
import TileGrid from "ol/tilegrid/TileGrid";
import type { Lattice, Point } from "../service/types";

/** A projection that projects nothing. */
export const METRES = new Projection({ code: "mapfit:metres", units: "m", axisOrientation: "enu" });

/** The service's tiles: at zoom z a side is 1024 / 2^z metres and 256 pixels; the corner of (0, 0) is the origin. */
const SIDE = 1024;
export const TILE = 256;
const DEEPEST = 14;

export function tileGrid(extent: Extent): TileGrid {
  const resolutions = Array.from({ length: DEEPEST + 1 }, (_, z) => SIDE / TILE / 2 ** z);
  return new TileGrid({ extent, origin: [0, 0], resolutions, tileSize: TILE });
}

/** OpenLayers counts rows downwards from the origin, the service upwards. */
export function rowUpwards(row: number): number {
  return -row - 1;
}

export function extentOf({ origin, resolution, cells }: Lattice): Extent {
  return [origin[0], origin[1], origin[0] + cells[0] * resolution, origin[1] + cells[1] * resolution];
}

export function sizeOf(extent: Extent): [number, number] {
  const [x0 = 0, y0 = 0] = getBottomLeft(extent);
  const [x1 = 0, y1 = 0] = getTopRight(extent);
  return [x1 - x0, y1 - y0];
}

/** Points on a regular grid over an extent: what a colour scale is chosen from. */
export function gridOver(extent: Extent, side: number): Point[] {
  const [x0 = 0, y0 = 0] = extent;
  const [width, height] = sizeOf(extent);
  const at = (k: number) => (k + 0.5) / side;
  return Array.from({ length: side * side }, (_, k): Point => [
    x0 + at(k % side) * width,
    y0 + at(Math.floor(k / side)) * height,
  ]);
}
