// CARMEN logs: `FLASER n r1..rn x y theta x y theta t host t`, metres and radians; read as the service's command line
// reads them (src/import/carmen.rs), so that a log makes the same job here and there.

import type { Scan } from "../service/types";

/** A range below this is the scanner seeing itself. */
const RANGE_MIN = 0.05;
/** The largest values mean "no return" where they come this often, and more often than the next ten values together. */
const REPEATED = 20;
/** How far apart the largest values may lie, metres. */
const SPREAD = 0.1;
const STEPS: Record<number, number> = { 180: 1, 181: 1, 360: 0.5, 361: 0.5 };

export class LogError extends Error {}

/** The scans of a log, in the file's order. */
export function parseCarmen(text: string): Scan[] {
  const scans: Scan[] = [];
  let line = 0;
  for (const words of lines(text)) {
    line += 1;
    if (!words.startsWith("FLASER")) continue;
    const parts = words.trim().split(/\s+/);
    if (parts[0] === "FLASER") scans.push(parseFlaser(parts, line));
  }
  if (scans.length === 0) throw new LogError("The log has no FLASER line, so no scan.");
  const none = noReturnValue(scans);
  let farthest = 2 * RANGE_MIN;
  for (const scan of scans) {
    scan.ranges = scan.ranges.map((range) => (range !== null && none !== null && range >= none ? null : range));
    for (const range of scan.ranges) if (range !== null && range > farthest) farthest = range;
  }
  for (const scan of scans) scan.range_max = farthest;
  return scans;
}

/** Line by line, without an array of all of them. */
function* lines(text: string): Generator<string> {
  for (let start = 0; start < text.length;) {
    const end = text.indexOf("\n", start);
    yield text.slice(start, end < 0 ? undefined : end);
    if (end < 0) return;
    start = end + 1;
  }
}

function parseFlaser(words: string[], line: number): Scan {
  const fail = (detail: string) => new LogError(`Line ${line}: ${detail}.`);
  const beams = Number(words[1]);
  if (!Number.isInteger(beams)) throw fail("FLASER needs a number of beams");
  const step = STEPS[beams];
  if (step === undefined) throw fail(`${beams} beams; 180, 181, 360 and 361 are known`);
  const number = (at: number, what: string) => {
    const word = words[at];
    if (word === undefined) throw fail(`the line ends before its ${what}`);
    const value = Number(word);
    if (!Number.isFinite(value)) throw fail(`${what} ${word} is not a number`);
    return value;
  };
  const ranges = Array.from({ length: beams }, (_, k) => number(2 + k, "range"));
  const [x, y, theta] = ["x", "y", "theta"].map((name, k) => number(2 + beams + k, name)) as [number, number, number];
  return {
    pose: { x, y, theta },
    angle_min: -Math.PI / 2,
    angle_increment: (step * Math.PI) / 180,
    range_min: RANGE_MIN,
    range_max: Infinity,
    ranges,
  };
}

/** The value from which ranges stand for "no return", where the log has one: logs differ, and some have several. */
function noReturnValue(scans: Scan[]): number | null {
  const counts = new Map<number, number>();
  for (const scan of scans) {
    for (const range of scan.ranges) {
      const value = Math.max(0, range ?? 0);
      counts.set(value, (counts.get(value) ?? 0) + 1);
    }
  }
  const values = [...counts.keys()].sort((a, b) => b - a);
  const largest = values[0] ?? 0;
  const top = values.filter((value) => value >= largest - SPREAD);
  const total = (some: number[]) => some.reduce((sum, value) => sum + (counts.get(value) ?? 0), 0);
  const repeated = total(top);
  const next = total(values.slice(top.length, top.length + 10));
  return repeated >= REPEATED && repeated > next ? (top.at(-1) ?? null) : null;
}
