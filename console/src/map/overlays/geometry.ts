// GeoJSON into paths for a canvas, in metres relative to an origin: far from it a canvas's numbers would be coarse.

import type { Geometry } from "../../service/maps";
import type { Point } from "../../service/types";

export function pathOf(geometry: Geometry, origin: Point): Path2D {
  const path = new Path2D();
  const closed = geometry.type.endsWith("Polygon");
  for (const line of linesOf(geometry)) {
    line.forEach(([x, y], k) =>
      k === 0 ? path.moveTo(x - origin[0], y - origin[1]) : path.lineTo(x - origin[0], y - origin[1]),
    );
    if (closed) path.closePath();
  }
  return path;
}

/** Lines, and rings of polygons: holes are rings too, and the even-odd rule leaves them open. */
export function linesOf({ type, coordinates }: Geometry): Point[][] {
  switch (type) {
    case "LineString":
      return [coordinates as Point[]];
    case "MultiLineString":
    case "Polygon":
      return coordinates as Point[][];
    case "MultiPolygon":
      return (coordinates as Point[][][]).flat();
    default:
      return [];
  }
}
