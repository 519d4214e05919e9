import { expect, test } from "vitest";
import { curlLine, pythonLine } from "../src/kit/downloads";
import { bytes, coordinate, duration, length } from "../src/kit/format";
import { brief } from "../src/map/answer";
import { fileName } from "../src/map/files";
import { of } from "../src/service/abilities";
import { latticeOf } from "../src/submit/estimate";

test("lengths have the unit that fits", () => {
  expect([0.0028, 0.028, 0.542, -12.3456, 1234.5, 0, -0].map(length)).toEqual([
    "2.8 mm",
    "28 mm",
    "0.542 m",
    "\u221212.346 m",
    "1234.5 m",
    "0.0 mm",
    "0.0 mm",
  ]);
  expect(coordinate(-0.0001)).toBe("0.000");
  expect([900, 64 * 1024 ** 2].map(bytes)).toEqual(["900 bytes", "64.0 MiB"]);
  expect([3.21, 59, 125, 7260].map(duration)).toEqual(["3.2 s", "59 s", "2 min 5 s", "2 h 1 min"]);
});

test("an answer in a few words", () => {
  const answer = { at: [0, 0] as [number, number], gradient: null, nearest: null, clearance: null };
  expect(brief({ ...answer, distance: -1.2, sigma: 0.0066, observed: true })).toBe("\u22121.200 m ± 6.6 mm");
  expect(brief({ ...answer, distance: 1.2, sigma: null, observed: false })).toBe("1.200 m, unseen");
  expect(brief({ ...answer, distance: null, sigma: null, observed: null })).toBe("outside this map");
});

test("lines to copy never hold a key", () => {
  const download = { title: "t", format: "f", path: "/v1/maps/1/poses", file: "p.json" };
  expect(curlLine(download, "http://h", false)).toBe('curl -sf "http://h/v1/maps/1/poses" -o p.json');
  expect(curlLine(download, "http://h", true)).toContain("Bearer $MAPFIT_KEY");
  expect(pythonLine(download, "http://h", true)).toContain('os.environ["MAPFIT_KEY"]');
});

test("a file's name is one that every shell takes", () => {
  expect(fileName({ name: "lab, floor 2; rm -rf /", id: "0123456789" })).toBe("lab-floor-2-rm--rf");
  expect(fileName({ name: "…", id: "0123456789" })).toBe("map-456789");
});

test("abilities are what the document says", () => {
  const able = of({
    paths: {
      "/v1/jobs": { post: { parameters: [{ name: "dry_run" }], requestBody: { content: { "application/json": {} } } } },
    },
  });
  expect(able.takes("post", "/v1/jobs", "dry_run")).toBe(true);
  expect(able.takes("get", "/v1/jobs", "dry_run")).toBe(false);
  expect(able.reads("post", "/v1/jobs", "multipart/form-data")).toBe(false);
  expect(able.has("get", "/v1/places")).toBe(false);
});

test("a lattice is laid around returns and poses with three cells to spare", () => {
  const summary = { box: [0, 0, 6, 4], given: null } as never;
  const settings = { map: { distance: "sdf", resolution: 0.5 } } as never;
  expect(latticeOf(summary, settings)).toMatchObject({
    origin: [-1.5, -1.5],
    cells: [18, 14],
    control_points: [21, 17],
  });
});
