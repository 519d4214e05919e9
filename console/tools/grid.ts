import { inflateRawSync } from "node:zlib";

/** A map's values on a grid. */
export interface Grid {
  signed: boolean;
  at(layer: string, x: number, y: number): number;
}

interface Shape {
  x: number;
  y: number;
  resolution: number;
  width: number;
  height: number;
}

const MOST_CELLS = 400_000;

async function ask(url: string, key: string | undefined): Promise<Response> {
  const response = await fetch(url, key ? { headers: { authorization: key } } : {});
  if (!response.ok) throw new Error(`${url}: ${response.status}`);
  return response;
}

async function fineness(base: string, key: string | undefined): Promise<{ signed: boolean; resolution: number }> {
  const map = (await (await ask(base, key)).json()) as {
    distance: string;
    lattice: { cells: number[]; resolution: number };
  };
  const [nx = 1, ny = 1] = map.lattice.cells;
  const finer = Math.max(1, Math.min(4, Math.floor(Math.sqrt(MOST_CELLS / (nx * ny)))));
  return { signed: map.distance === "sdf", resolution: map.lattice.resolution / finer };
}

function sampled(signed: boolean, shape: Shape, layers: Map<string, ArrayLike<number>>): Grid {
  const at = (layer: string, x: number, y: number) => {
    const [i, j] = [Math.floor((x - shape.x) / shape.resolution), Math.floor((y - shape.y) / shape.resolution)];
    if (i < 0 || j < 0 || i >= shape.width || j >= shape.height) return Number.NaN;
    return layers.get(layer)?.[i + j * shape.width] ?? Number.NaN;
  };
  return { signed, at };
}

export async function valueGrid(service: string, id: string, kind: string, key?: string): Promise<Grid> {
  const base = `${service}/v1/maps/${id}`;
  const { signed, resolution } = await fineness(base, key);
  const response = await ask(`${base}/grid?resolution=${resolution}&kind=${kind}&format=npz`, key);
  const arrays = npz(Buffer.from(await response.arrayBuffer()));
  const [x = 0, y = 0] = Array.from(arrays.get("origin")?.values ?? []);
  const [height = 0, width = 0] = arrays.get("distance")?.shape ?? [];
  const layers = new Map([...arrays].map(([name, { values }]) => [name, values]));
  return sampled(signed, { x, y, resolution, width, height }, layers);
}

export async function occupancyGrid(service: string, id: string, kind: string, key?: string): Promise<Grid> {
  const base = `${service}/v1/maps/${id}`;
  const { signed, resolution } = await fineness(base, key);
  const { info, data } = (await (await ask(`${base}/ogm?resolution=${resolution}&kind=${kind}`, key)).json()) as {
    info: { width: number; height: number; resolution: number; origin: { position: { x: number; y: number } } };
    data: number[];
  };
  const values = data.map((percent) => (percent < 0 ? Number.NaN : percent));
  return sampled(signed, { ...info.origin.position, ...info }, new Map([["occupancy", values]]));
}

/** The arrays of an npz file, little-endian floats alone. */
function npz(file: Buffer): Map<string, { shape: number[]; values: ArrayLike<number> }> {
  const arrays = new Map<string, { shape: number[]; values: ArrayLike<number> }>();
  const end = file.lastIndexOf(Buffer.from("PK\x05\x06", "latin1"));
  let entry = file.readUInt32LE(end + 16);
  for (let k = 0; k < file.readUInt16LE(end + 10); k += 1) {
    const [method, size] = [file.readUInt16LE(entry + 10), file.readUInt32LE(entry + 20)];
    const [nameSize, extraSize, noteSize] = [28, 30, 32].map((at) => file.readUInt16LE(entry + at)) as [
      number,
      number,
      number,
    ];
    const local = file.readUInt32LE(entry + 42);
    const name = file.toString("latin1", entry + 46, entry + 46 + nameSize).replace(/\.npy$/, "");
    const start = local + 30 + file.readUInt16LE(local + 26) + file.readUInt16LE(local + 28);
    const packed = file.subarray(start, start + size);
    arrays.set(name, npy(method === 8 ? inflateRawSync(packed) : packed));
    entry += 46 + nameSize + extraSize + noteSize;
  }
  return arrays;
}

function npy(bytes: Buffer): { shape: number[]; values: ArrayLike<number> } {
  const long = bytes[6] !== 1;
  const size = long ? bytes.readUInt32LE(8) : bytes.readUInt16LE(8);
  const start = (long ? 12 : 10) + size;
  const header = bytes.toString("latin1", 10, start);
  const shape = (/'shape': \(([^)]*)\)/.exec(header)?.[1] ?? "")
    .split(",")
    .map((part) => part.trim())
    .filter(Boolean)
    .map(Number);
  const body = new Uint8Array(bytes.subarray(start)).buffer;
  return { shape, values: header.includes("<f4") ? new Float32Array(body) : new Float64Array(body) };
}
