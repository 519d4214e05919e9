// What the colours and lines mean, with units.

import { make, write } from "../kit/element";
import { type Theme, theme } from "../kit/theme";
import type { Layer } from "../service/maps";
import type { Distance, Kind } from "../service/types";
import { colours, inks } from "./palette";
import type { Overlay } from "./view";

export interface Shown {
  layer: Layer;
  kind: Kind;
  distance: Distance;
  max: number;
  overlays: Set<Overlay>;
  /** How much larger than life poses' ellipses are drawn; null without any. */
  enlarged: number | null;
  /** The same of located scans. */
  located: number | null;
}

const TITLES: Record<Layer, string> = {
  distance: "Distance to the nearest surface",
  sigma: "Standard deviation of the distance",
  occupancy: "Probability of a surface",
  clearance: "Clearance: to a surface or unseen space",
};

/** Height of a legend with colours and one line, pixels. */
const LEAST = 130;

export class Legend {
  private readonly title = make("summary", {});
  private readonly content = make("div", {});
  /** Folded where it hides the map. */
  readonly element = make(
    "div",
    { class: "legend", role: "region", "aria-label": "Legend" },
    make("details", { open: true }, this.title, this.content),
  );
  private shown = "";

  /** Width and height that it covers of the map's upper right corner; nothing where it lies below the map. */
  covers(): [number, number] {
    if (getComputedStyle(this.element).position !== "absolute") return [0, 0];
    const { offsetWidth, offsetHeight, offsetTop } = this.element;
    // Before its colours are known it is smaller than it is going to be.
    return [offsetWidth + offsetTop, Math.max(offsetHeight, LEAST) + offsetTop];
  }

  show(shown: Shown): void {
    const state = JSON.stringify([shown, [...shown.overlays], theme()]);
    if (state === this.shown) return;
    this.shown = state;
    const bar = make("div", { class: "colours", "aria-hidden": "true" });
    bar.style.background = `linear-gradient(to right, ${colours(shown.layer, shown.distance, theme()).join(", ")})`;
    const ticks = make("div", { class: "ticks" }, ...ticksOf(shown).map((text) => make("span", {}, text)));
    const kind = shown.layer === "sigma" ? ` (${shown.kind})` : "";
    const lines = [...shown.overlays].map((overlay) => line(overlay, theme(), shown.enlarged));
    if (shown.located !== null) lines.push(locatedLine(theme(), shown.located));
    write(this.title, TITLES[shown.layer] + kind);
    this.content.replaceChildren(bar, ticks, ...lines, make("p", { class: "note" }, "No colour: nobody looked there."));
  }
}

/** The scale's ends and middle; the upper end is where colours stop, not where values do. */
export function ticksOf({ layer, distance, max }: Pick<Shown, "layer" | "distance" | "max">): string[] {
  if (layer === "occupancy") return ["0 %", "50 %", "100 %"];
  const millimetres = max < 0.1;
  const text = (metres: number) =>
    String(Number((millimetres ? metres * 1000 : metres).toPrecision(3))).replace("-", "\u2212");
  const unit = millimetres ? "mm" : "m";
  if (layer === "distance" && distance === "sdf") return [`${text(-max)} free`, "0", `≥ ${text(max)} ${unit} beyond`];
  return ["0", text(max / 2), `≥ ${text(max)} ${unit}`];
}

function swatch(name: string, colour: string): HTMLElement {
  const element = make("span", { class: `swatch ${name}`, "aria-hidden": "true" });
  element.style.color = colour;
  return element;
}

function ellipse(times: number): string {
  return times === 1 ? ", 2σ ellipse" : `, 2σ ellipse drawn ${times} times as large`;
}

function locatedLine(theme: Theme, times: number): HTMLElement {
  return make("p", {}, swatch("dot", inks(theme).place), `located scan, its returns${ellipse(times)}`);
}

function line(overlay: Overlay, theme: Theme, enlarged: number | null): HTMLElement {
  const ink = inks(theme);
  const [r, g, b] = ink.returns;
  switch (overlay) {
    case "contour":
      return make("p", {}, swatch("stroke", ink.contour), "surface ", swatch("area", ink.band), "within 2σ");
    case "returns":
      return make("p", {}, swatch("dot", `rgb(${r} ${g} ${b})`), "returns");
    case "poses":
      return make("p", {}, swatch("dot", ink.poses), `pose${enlarged === null ? "" : ellipse(enlarged)}`);
    case "changes":
      return make("p", {}, swatch("area", ink.appeared), "appeared ", swatch("area", ink.vanished), "vanished");
    case "frames":
      return make("p", {}, swatch("stroke", ink.mark), "frames of the joined maps");
  }
}
