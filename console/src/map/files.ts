// Every file a map can be had as.

import type { Download } from "../kit/downloads";
import type { Abilities } from "../service/abilities";
import { mapPath } from "../service/maps";
import type { Kind, MapRecord } from "../service/types";

/** What of a map the files are to be of: a kind of uncertainty, the map that changes are told from, whether it was joined. */
export interface Wanted {
  kind: Kind;
  since: string | null;
  joined: boolean;
}

export function filesOf(map: MapRecord, { kind, since, joined }: Wanted, able: Abilities | null): Download[] {
  const base = mapPath(map.id);
  const name = fileName(map);
  const file = (title: string, format: string, path: string, end: string, note?: string): Download => ({
    title,
    format,
    path: `${base}/${path}`,
    file: `${name}-${end}`,
    ...(note ? { note } : {}),
  });
  const of = kind === "posterior" ? "&kind=posterior" : "";
  const files = [
    file(
      "Distance, sigma, clearance",
      "npz, float32",
      `grid?format=npz${of}`,
      "grid.npz",
      "Values at cell centres; NaN where nobody looked.",
    ),
    file("Distance, sigma, clearance", "GeoTIFF", `grid?format=tiff${of}`, "grid.tif"),
    file("Occupancy for Nav2, trinary", "zip of map.yaml and map.pgm", `ogm?format=zip${of}`, "nav2.zip"),
    file(
      "Occupancy for Nav2, scale",
      "zip of map.yaml and PNG",
      `ogm?format=zip&mode=scale${of}`,
      "nav2-scale.zip",
      "Probabilities between free and occupied; unseen is transparent.",
    ),
    file(
      "Occupancy for Nav2, raw",
      "zip of map.yaml and PNG",
      `ogm?format=zip&mode=raw${of}`,
      "nav2-raw.zip",
      "The grid's own numbers, 0 to 100; unseen is 255.",
    ),
    file("Occupancy", "JSON, nav_msgs/OccupancyGrid", `ogm?format=json${of}`, "occupancy.json"),
    file("Occupancy", "PNG", `ogm?format=png${of}`, "occupancy.png"),
    file(
      "Surfaces with their 2σ band",
      "GeoJSON",
      `contours?level=0&sigma_band=2&format=geojson${of}`,
      "contours.geojson",
    ),
    file("Surfaces with their 2σ band", "SVG", `contours?level=0&sigma_band=2&format=svg${of}`, "contours.svg"),
    file("Picture of the distance", "PNG", `image?layer=distance&overlay=contour&width=1600${of}`, "distance.png"),
    file("Picture of the distance", "SVG", `image?layer=distance&overlay=contour&format=svg${of}`, "distance.svg"),
    file("Picture of sigma", "PNG", `image?layer=sigma&overlay=contour&width=1600${of}`, "sigma.png"),
    file(
      "Picture of the occupancy",
      "PNG",
      `image?layer=occupancy&overlay=poses&width=1600${of}`,
      "occupancy-picture.png",
    ),
    file("Coefficients", "npz", "coefficients?format=npz", "coefficients.npz", "The spline itself."),
    file("Coefficients", "JSON", "coefficients?format=json", "coefficients.json"),
    file("Their variances", "npz", `covariance?form=diagonal&format=npz${of}`, "variances.npz"),
    file("Their covariance, sparse", "npz for scipy.sparse", `covariance?form=sparse${of}`, "covariance.npz"),
    file("Factors of the covariance", "npz", "covariance?form=factors", "factors.npz"),
    file("Poses with covariances", "JSON", "poses", "poses.json"),
  ];
  const knows = (part: string) => able?.has("get", `/v1/maps/{id}/${part}`);
  if (knows("mcap"))
    files.splice(5, 0, file("Grids for Foxglove and Lichtblick", "MCAP", `mcap${of.replace("&", "?")}`, "map.mcap"));
  if (knows("surfaces"))
    files.push(file("Surfaces that distances are told from", "npz", "surfaces?format=npz", "surfaces.npz"));
  if (knows("frames") && joined) files.push(file("Frames of the joined maps", "JSON", "frames", "frames.json"));
  if (knows("changes") && since) {
    const changes = `changes?since=${encodeURIComponent(since)}`;
    files.push(
      file("Changes from the other map", "GeoJSON", `${changes}&format=geojson`, "changes.geojson"),
      file("Changes from the other map", "SVG", `${changes}&format=svg`, "changes.svg"),
      file("Changes from the other map", "PNG", `${changes}&format=png`, "changes.png"),
    );
  }
  return files;
}

/** A name that every file system and shell takes as it is. */
export function fileName(map: { name: string | null; id: string }): string {
  const plain = (map.name ?? "")
    .normalize("NFKD")
    .replace(/[^\w.-]+/g, "-")
    .replace(/^[-.]+|[-.]+$/g, "")
    .slice(0, 60);
  return plain || `map-${map.id.slice(-6)}`;
}
