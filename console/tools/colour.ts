import { colours } from "../src/map/palette.ts";

/** The colour of a value as straight RGBA; nothing where it is not a number. */
export function colour(layer: string, signed: boolean, theme: string, max: number, value: number): number[] {
  if (Number.isNaN(value)) return [0, 0, 0, 0];
  const stops = colours(layer as never, signed ? "sdf" : "vdf", theme as never);
  const share =
    layer === "occupancy" ? value / 100 : layer === "distance" && signed ? 0.5 + value / max / 2 : value / max;
  const place = Math.min(Math.max(share, 0), 1) * (stops.length - 1);
  const low = Math.min(Math.floor(place), stops.length - 2);
  const [a, b] = [stops[low], stops[low + 1]].map((hex = "#000000") =>
    [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16)),
  );
  return [...[0, 1, 2].map((k) => Math.round((a?.[k] ?? 0) + ((b?.[k] ?? 0) - (a?.[k] ?? 0)) * (place - low))), 255];
}
