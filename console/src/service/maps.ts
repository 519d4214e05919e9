// Maps, as the service knows them.

import { get, request, withQuery } from "./client";
import type {
  Answers,
  FittedPoses,
  Frame,
  Kind,
  LocatedScan,
  MapRecord,
  Noise,
  Page,
  Point,
  Pose,
  Scan,
} from "./types";

export function mapPath(id: string): string {
  return `/v1/maps/${encodeURIComponent(id)}`;
}

export function getMap(id: string, signal?: AbortSignal): Promise<MapRecord> {
  return get(mapPath(id), signal);
}

export function listMaps(
  query: { label?: string | null; cursor?: string | null; limit?: number },
  signal?: AbortSignal,
): Promise<Page<MapRecord>> {
  return get(withQuery("/v1/maps", query), signal);
}

export function queryMap(
  id: string,
  points: Point[],
  kind: Kind,
  fields: string[],
  signal?: AbortSignal,
): Promise<Answers> {
  const body = JSON.stringify({ points, kind, fields });
  const init = { method: "POST", body, headers: { "content-type": "application/json" }, signal: signal ?? null };
  return request(`${mapPath(id)}/query`, init).then((response) => response.json());
}

/** What can be coloured. */
export type Layer = "distance" | "sigma" | "occupancy" | "clearance";
export const LAYERS: Layer[] = ["distance", "sigma", "occupancy", "clearance"];

export interface TileStyle {
  layer: Layer;
  kind: Kind;
  theme: string;
  /** Where the colours end, metres. */
  max: number;
}

/** A picture of 256 by 256 pixels; `y` counts upwards, as everything in the map's frame does. */
export function tilePath(id: string, style: TileStyle, z: number, x: number, y: number): string {
  const max = style.layer === "occupancy" ? null : style.max;
  const query = { kind: style.kind, theme: style.theme, max };
  return withQuery(`${mapPath(id)}/tiles/${style.layer}/${z}/${x}/${y}`, query);
}

export interface Geometry {
  type: string;
  coordinates: unknown;
}
export interface Features {
  features: { geometry: Geometry; properties: { role: string; probability?: number; area?: number } }[];
}

export function getContours(id: string, kind: Kind, signal: AbortSignal): Promise<Features> {
  return get(withQuery(`${mapPath(id)}/contours`, { level: 0, sigma_band: 2, kind, format: "json" }), signal);
}

/** What differs from another map beyond what both maps' uncertainty explains. */
export function getChanges(id: string, since: string, signal: AbortSignal): Promise<Features> {
  return get(withQuery(`${mapPath(id)}/changes`, { since }), signal);
}

export function getPoses(id: string, signal: AbortSignal): Promise<FittedPoses> {
  return get(`${mapPath(id)}/poses`, signal);
}

/** The frames of a joined map; none of any other. */
export function getFrames(id: string, signal: AbortSignal): Promise<{ frames: Frame[] }> {
  return get(`${mapPath(id)}/frames`, signal);
}

/** What is known of scans that are to be located: a scan's pose is the prior, with the noise's sigmas; null is anywhere. */
export interface Sighting {
  scans: (Omit<Scan, "pose"> & { pose: Pose | null })[];
  noise: Noise;
  kind: Kind;
  hypotheses: number;
}

export async function localize(id: string, sighting: Sighting, signal: AbortSignal): Promise<LocatedScan[]> {
  const init = {
    method: "POST",
    body: JSON.stringify(sighting),
    headers: { "content-type": "application/json" },
    signal,
  };
  return (await (await request(`${mapPath(id)}/localize`, init)).json()).poses;
}
