// The colours of the service's tiles, for the legend. They are the service's to choose: what is here repeats them.

import type { Theme } from "../kit/theme";
import type { Layer } from "../service/maps";
import type { Distance } from "../service/types";

const ramp = (text: string) => text.split(" ").map((hex) => `#${hex}`);

const VIRIDIS = ramp("440154 482576 414487 35608d 2a788e 21908d 22a884 43bf71 7ad151 bbdf27 fde725");
const INFERNO = ramp("000004 160b39 420a68 6a176e 932667 bc3754 dd513a f37819 fca50a f6d746 fcffa4");
const CIVIDIS = ramp("002051 0a326a 2b446e 4d566d 696970 7f7c75 948f78 ada476 caba6a ead156 fdea45");
const BLUE_RED = ramp("053061 2166ac 4393c3 92c5de d1e5f0 f7f7f7 fddbc7 f4a582 d6604d b2182b 67001f");
const YELLOW_GREEN_BLUE = ramp("ffffd9 edf8b1 c7e9b4 7fcdbb 41b6c4 1d91c0 225ea8 253494 081d58");
const YELLOW_GREEN = ramp("ffffe5 f7fcb9 d9f0a3 addd8e 78c679 41ab5d 238443 006837 004529");
const GREYS = ramp("ffffff f0f0f0 d9d9d9 bdbdbd 969696 737373 525252 252525 000000");

/** Colours from a scale's lower end to its upper one, as src/render/tile.rs has them. */
export function colours(layer: Layer, distance: Distance, theme: Theme): string[] {
  const dark = theme === "dark";
  switch (layer) {
    case "sigma":
      return VIRIDIS;
    case "occupancy":
      return dark ? [...GREYS].reverse() : GREYS;
    case "clearance":
      return dark ? CIVIDIS : YELLOW_GREEN;
    case "distance":
      // A signed distance is negative in free space, which is blue.
      if (distance === "sdf") return BLUE_RED;
      return dark ? INFERNO : YELLOW_GREEN_BLUE;
  }
}

/** What is drawn over the colours. */
export interface Inks {
  contour: string;
  /** Around the contour. */
  rim: string;
  band: string;
  returns: [r: number, g: number, b: number, a: number];
  poses: string;
  /** Of located scans: returns, poses. */
  located: [r: number, g: number, b: number, a: number];
  place: string;
  mark: string;
  halo: string;
  appeared: string;
  vanished: string;
}

export function inks(theme: Theme): Inks {
  return theme === "dark"
    ? {
        contour: "#ffffff",
        rim: "#000000c0",
        band: "#ff9be099",
        returns: [255, 158, 74, 230],
        poses: "#d6b9ff",
        located: [126, 255, 150, 235],
        place: "#7eff96",
        mark: "#ffffff",
        halo: "#000000",
        appeared: "#ff6b6bb0",
        vanished: "#66d9ffb0",
      }
    : {
        contour: "#101010",
        rim: "#ffffffb0",
        band: "#d6009a66",
        returns: [200, 70, 0, 220],
        poses: "#5b2fae",
        located: [214, 0, 28, 235],
        place: "#c4001a",
        mark: "#000000",
        halo: "#ffffff",
        appeared: "#d01010a0",
        vanished: "#0070d0a0",
      };
}
