// The scale bar, the coordinates, and the buttons that zoom: what lies on the map's corners.

import { icon, make, write } from "../kit/element";
import { coordinate, length } from "../kit/format";
import type { Point } from "../service/types";
import { round } from "./scale";

const LONGEST = 120;

export class ScaleBar {
  private readonly bar = make("div", { class: "scale-bar", "aria-hidden": "true" });
  private readonly text = make("span", {});
  private readonly place = make("span", { class: "coordinates", "aria-hidden": "true" });
  readonly element = make(
    "div",
    { class: "scale" },
    make("div", { class: "scale-line" }, this.bar, this.text),
    this.place,
  );

  /** For so many metres a pixel: the longest round length that is not too long. */
  show(resolution: number): void {
    let metres = round(LONGEST * resolution);
    if (metres > LONGEST * resolution) metres = metres / (String(metres).includes("5") ? 2.5 : 2);
    this.bar.style.width = `${metres / resolution}px`;
    write(this.text, metres >= 1 ? `${Number(metres.toPrecision(3))} m` : length(metres));
  }

  point(at: Point | null): void {
    write(this.place, at ? `x ${coordinate(at[0])}  y ${coordinate(at[1])} m` : "");
  }
}

export function zoomButtons(actions: { zoom(by: number): void; fit(): void }): HTMLElement {
  const button = (label: string, path: string, act: () => void) =>
    make("button", { type: "button", class: "square", "aria-label": label, title: label, onclick: act }, icon(path));
  return make(
    "div",
    { class: "zoom", role: "group", "aria-label": "Zoom" },
    button("Zoom in", "M8 3v10M3 8h10", () => actions.zoom(1)),
    button("Zoom out", "M3 8h10", () => actions.zoom(-1)),
    button("Show the whole map", "M2 6V2h4M10 2h4v4M14 10v4h-4M6 14H2v-4", () => actions.fit()),
  );
}
