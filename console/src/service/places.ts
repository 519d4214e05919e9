// Places: names under which maps follow one another.

import { get, send, withQuery } from "./client";
import type { Page, Place } from "./types";

export const NAME_PATTERN = "[a-z0-9][a-z0-9._\\-]{0,62}";

export function placePath(name: string): string {
  return `/v1/places/${encodeURIComponent(name)}`;
}

export function listPlaces(cursor: string | null, signal: AbortSignal): Promise<Page<Place>> {
  return get(withQuery("/v1/places", { cursor, limit: 50 }), signal);
}

export function getPlace(name: string, signal: AbortSignal): Promise<Place> {
  return get(placePath(name), signal);
}

export function listVersions(name: string, cursor: string | null, signal: AbortSignal): Promise<Page<Place>> {
  return get(withQuery(`${placePath(name)}/versions`, { cursor, limit: 50 }), signal);
}

/** Publishes a map as the next version; a new place is made only where there is none, so that no one is overrun. */
export function publish(name: string, mapId: string, note: string, isNew: boolean): Promise<Place> {
  const body = { map_id: mapId, ...(note ? { note } : {}) };
  return send("PUT", placePath(name), body, isNew ? { "if-none-match": "*" } : {});
}

export function rollBack(name: string, version: number): Promise<Place> {
  return send("POST", `${placePath(name)}/rollback`, { version });
}

export function deletePlace(name: string): Promise<void> {
  return send("DELETE", placePath(name));
}
