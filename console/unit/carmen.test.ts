// What src/import/carmen.rs holds, held here too.

import { describe, expect, test } from "vitest";
import { parseCarmen } from "../src/scan/carmen";

const line = (range: (k: number) => number) =>
  `FLASER 180 ${Array.from({ length: 180 }, (_, k) => range(k).toFixed(2)).join(" ")} 1.5 -2.0 7.0 1.4 -2.0 7.0 12.5 host 12.6`;

describe("a CARMEN log", () => {
  test("has scans, and other lines that are passed over", () => {
    const scans = parseCarmen(`# a comment\nPARAM x 1\nODOM 1 2 3\n${line((k) => 1 + 0.01 * k)}\r\n`);
    expect(scans).toHaveLength(1);
    expect(scans[0]?.pose).toEqual({ x: 1.5, y: -2, theta: 7 });
    expect(scans[0]?.ranges[179]).toBe(2.79);
    expect(scans[0]?.range_max).toBe(2.79);
  });

  test("has no return where the value at the top repeats", () => {
    const [scan] = parseCarmen(line((k) => (k % 3 === 0 ? 81.83 : k % 10 === 1 ? 81.87 : 2 + 0.01 * k)));
    expect(scan?.ranges.slice(0, 2)).toEqual([null, null]);
    expect(scan?.ranges[2]).toBe(2.02);
    expect(scan?.range_max).toBeLessThan(10);
  });

  test("that is torn says where and what", () => {
    expect(() => parseCarmen(`ODOM\n${line(() => 1).slice(0, 300)}`)).toThrow(
      /^Line 2: the line ends before its range/,
    );
    expect(() => parseCarmen("ODOM 1 2 3\n")).toThrow(/no FLASER/);
    expect(() => parseCarmen("FLASER 7 1 2 3\n")).toThrow(/7 beams/);
    expect(() => parseCarmen(line(() => 1).replace("1.00", "x"))).toThrow(/range x is not a number/);
  });
});
