// Everything about the map view that can be linked: what its address says, and the address that says it.

import { type Address, type Query, href } from "../route/address";
import { LAYERS, type Layer } from "../service/maps";
import type { Kind, Point } from "../service/types";

export type Overlay = "contour" | "returns" | "poses" | "changes" | "frames";
export const OVERLAYS: Overlay[] = ["contour", "returns", "poses", "changes", "frames"];

/** Where one looks from: the centre, and metres a pixel. */
export interface Camera {
  center: Point;
  resolution: number;
}

export interface View {
  layer: Layer;
  kind: Kind;
  opacity: number;
  overlays: Set<Overlay>;
  /** The point asked about. */
  at: Point | null;
  ruler: [Point, Point] | null;
  /** The map on the other side of the swipe, and where its edge stands, from 0 to 1. */
  compare: string | null;
  swipe: number;
  camera: Camera | null;
}

export const FIRST: View = {
  layer: "distance",
  kind: "propagated",
  opacity: 1,
  overlays: new Set(["contour"]),
  at: null,
  ruler: null,
  compare: null,
  swipe: 0.5,
  camera: null,
};

export function viewOf({ query }: Address): View {
  const layer = query.get("layer") as Layer;
  const shown = query.get("show");
  const ruler = numbers(query.get("ruler"), 4);
  const camera = numbers(query.get("view"), 3);
  return {
    layer: LAYERS.includes(layer) ? layer : FIRST.layer,
    kind: query.get("kind") === "posterior" ? "posterior" : "propagated",
    opacity: share(query.get("opacity"), FIRST.opacity),
    overlays: shown === null ? FIRST.overlays : new Set(OVERLAYS.filter((one) => shown.split(",").includes(one))),
    at: numbers(query.get("at"), 2) as Point | null,
    ruler: ruler && [ruler.slice(0, 2) as Point, ruler.slice(2) as Point],
    compare: query.get("compare"),
    swipe: share(query.get("swipe"), FIRST.swipe),
    camera:
      camera && (camera[2] ?? 0) > 0 ? { center: camera.slice(0, 2) as Point, resolution: camera[2] as number } : null,
  };
}

/** The address of a view; what is as it is at first is left out. */
export function hrefOf(id: string, view: View): string {
  const shown = OVERLAYS.filter((one) => view.overlays.has(one)).join(",");
  const shownFirst = OVERLAYS.filter((one) => FIRST.overlays.has(one)).join(",");
  const query: Query = {
    layer: view.layer === FIRST.layer ? null : view.layer,
    kind: view.kind === FIRST.kind ? null : view.kind,
    opacity: view.opacity === FIRST.opacity ? null : String(view.opacity),
    show: shown === shownFirst ? null : shown || "none",
    at: view.at && line(view.at),
    ruler: view.ruler && line(view.ruler.flat()),
    compare: view.compare,
    swipe: view.compare && view.swipe !== FIRST.swipe ? String(view.swipe) : null,
    view: view.camera && `${line(view.camera.center)},${Number(view.camera.resolution.toPrecision(5))}`,
  };
  return href(["maps", id], query);
}

/** To the tenth of a millimetre. */
function line(numbers: number[]): string {
  return numbers.map((number) => Number(number.toFixed(4))).join(",");
}

function numbers(text: string | null, count: number): number[] | null {
  const all = (text ?? "").split(",").map((part) => (part.trim() === "" ? Number.NaN : Number(part)));
  return all.length === count && all.every(Number.isFinite) ? all : null;
}

function share(text: string | null, otherwise: number): number {
  const number = Number(text);
  return text !== null && number >= 0 && number <= 1 ? number : otherwise;
}
