/**
 * Tiles for a service that has none yet, made from its grids: development and tests go on without them. A service whose
 * document names the tile route is left to answer itself.
 */

import type { Connect, Plugin } from "vite";
import { type Grid, occupancyGrid, valueGrid } from "./grid.ts";
import { encodePng } from "./png.ts";
import { colour } from "./colour.ts";

const ROUTE = /^\/v1\/maps\/([^/]+)\/tiles\/(distance|sigma|occupancy|clearance)\/(\d+)\/(-?\d+)\/(-?\d+)\?(.*)$/;
const SIDE = 256;

export function standInTiles(service: string): Plugin {
  const grids = new Map<string, Promise<Grid>>();
  let native: Promise<boolean> | null = null;
  const hasTiles = async () => {
    const document = (await (await fetch(`${service}/openapi.json`)).json()) as { paths: object };
    return Object.keys(document.paths).some((path) => path.includes("/tiles/"));
  };
  const answer: Connect.NextHandleFunction = async (request, response, next) => {
    const match = ROUTE.exec(request.url ?? "");
    if (!match) return next();
    native ??= hasTiles().catch(() => false);
    if (await native) return next();
    const [, id = "", layer = "", z, x, y, query] = match;
    const { kind = "propagated", theme = "light", max = "1" } = Object.fromEntries(new URLSearchParams(query));
    const key = `${id} ${layer === "occupancy" ? layer : "values"} ${kind}`;
    const make = layer === "occupancy" ? occupancyGrid : valueGrid;
    if (!grids.has(key)) grids.set(key, make(service, id, kind, request.headers.authorization));
    try {
      const grid = (await grids.get(key)) as Grid;
      const side = 1024 / 2 ** Number(z);
      const pixels = new Uint8Array(4 * SIDE * SIDE);
      for (let k = 0; k < SIDE * SIDE; k += 1) {
        const px = (Number(x) + ((k % SIDE) + 0.5) / SIDE) * side;
        const py = (Number(y) + 1 - (Math.floor(k / SIDE) + 0.5) / SIDE) * side;
        pixels.set(colour(layer, grid.signed, theme, Number(max), grid.at(layer, px, py)), 4 * k);
      }
      response.setHeader("content-type", "image/png");
      response.setHeader("cache-control", "private, no-cache");
      response.end(encodePng(SIDE, SIDE, pixels));
    } catch (error) {
      grids.delete(key);
      response.statusCode = 502;
      response.end(String(error));
    }
  };
  return {
    name: "stand-in-tiles",
    configureServer: (server) => void server.middlewares.use(answer),
    configurePreviewServer: (server) => void server.middlewares.use(answer),
  };
}
