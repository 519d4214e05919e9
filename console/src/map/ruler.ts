// The ruler: two clicks, a line, its length.

import { make } from "../kit/element";
import type { Point } from "../service/types";
import { describeRuler } from "./answer";
import type { MarksOverlay } from "./overlays/marks";
import { toolbar } from "./tools";

export type Line = [from: Point, to: Point];

export class Ruler {
  readonly element = make("div", { class: "answer", role: "status" });
  readonly tools = toolbar((on) => {
    this.on = on;
    this.begun = null;
  });
  private on = false;
  private begun: Point | null = null;

  constructor(
    private readonly marks: MarksOverlay,
    private readonly measured: (line: Line | null) => void,
  ) {}

  /** Takes a click where it is the ruler's. */
  takes(point: Point): boolean {
    if (!this.on) return false;
    const from = this.begun;
    this.begun = from ? null : point;
    if (from) {
      this.measured([from, point]);
    } else {
      this.marks.set({ ruler: [point, null] });
      this.element.replaceChildren(describeRuler(point, null));
    }
    return true;
  }

  show(line: Line | null): void {
    this.marks.set({ ruler: line });
    if (!line) return this.element.replaceChildren();
    const clear = () => this.measured(null);
    const button = make("button", { type: "button", class: "small", onclick: clear }, "Clear the ruler");
    this.element.replaceChildren(describeRuler(...line), button);
  }
}
