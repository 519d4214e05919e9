import { expect, test } from "vitest";
import { hrefOf, viewOf, FIRST } from "../src/map/view";
import { href, parse } from "../src/route/address";

test("an address comes back as it went", () => {
  const address = parse(href(["maps", "a/b c"], { label: "site:hq & more", cursor: null, status: "" }));
  expect(address.path).toEqual(["maps", "a/b c"]);
  expect([...address.query]).toEqual([["label", "site:hq & more"]]);
});

test("a broken address is no error", () => {
  expect(parse("#/maps/%E0%A4%A").path).toEqual(["maps", "%E0%A4%A"]);
  expect(parse("").path).toEqual([]);
});

test("a view comes back from its address", () => {
  const view = {
    ...FIRST,
    layer: "sigma" as const,
    kind: "posterior" as const,
    opacity: 0.4,
    overlays: new Set(["returns", "poses"] as const),
    at: [1.25, -3] as [number, number],
    ruler: [
      [0, 0],
      [1, 2],
    ] as [[number, number], [number, number]],
    compare: "other",
    swipe: 0.25,
    camera: { center: [3, 4] as [number, number], resolution: 0.02 },
  };
  expect(viewOf(parse(hrefOf("id", view)))).toEqual(view);
});

test("what an address says wrongly is left as it is at first", () => {
  expect(viewOf(parse("#/maps/id?layer=heat&kind=x&opacity=7&at=1&view=1,2,-3&ruler=a,b,c,d&swipe=-1"))).toEqual(FIRST);
  expect(viewOf(parse("#/maps/id?show=none")).overlays.size).toBe(0);
});
