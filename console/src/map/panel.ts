// The controls beside the map. They show the view, and ask for another; nothing is changed but through the address.

import { make } from "../kit/element";
import { moment } from "../kit/format";
import { LAYERS, type Layer } from "../service/maps";
import type { Kind, MapRecord } from "../service/types";
import { jobName } from "../jobs/actions";
import { type Overlay, OVERLAYS, type View } from "./view";

export interface Wishes {
  /** Another view; an entry of its own in the history, or not. */
  go(change: Partial<View>): void;
  opacity(value: number): void;
}

const WORDS: Record<Layer | Kind | Overlay, string> = {
  distance: "Distance",
  sigma: "Sigma",
  occupancy: "Occupancy",
  clearance: "Clearance",
  propagated: "Propagated",
  posterior: "Posterior",
  contour: "Surfaces with their 2σ band",
  returns: "Returns",
  poses: "Poses with ellipses",
  changes: "Changes from the other map",
  frames: "Frames of the joined maps",
};

export class Panel {
  private readonly layers = choice("Layer", "layer", LAYERS, (layer) => this.wishes.go({ layer }));
  private readonly kinds = choice<Kind>("Uncertainty", "kind", ["propagated", "posterior"], (kind) =>
    this.wishes.go({ kind }),
  );
  private readonly boxes = OVERLAYS.map((overlay) => {
    const input = make("input", { type: "checkbox", onchange: () => this.toggle(overlay, input.checked) });
    const note = make("span", { class: "note" });
    return {
      overlay,
      input,
      note,
      element: make("label", { class: "check" }, input, make("span", {}, WORDS[overlay], " ", note)),
    };
  });
  private readonly opacity = make("input", { type: "range", min: 0, max: 1, step: 0.05, id: "opacity" });
  private readonly compare = make("select", { id: "compare" });
  private overlays = new Set<Overlay>();
  private joined = false;
  readonly element: HTMLElement;

  constructor(
    private readonly wishes: Wishes,
    private readonly able: { changes: boolean },
  ) {
    this.opacity.addEventListener("input", () => this.wishes.opacity(Number(this.opacity.value)));
    this.opacity.addEventListener("change", () => this.wishes.go({ opacity: Number(this.opacity.value) }));
    this.compare.addEventListener("change", () => this.wishes.go({ compare: this.compare.value || null }));
    this.element = make(
      "div",
      { class: "controls" },
      this.layers.element,
      this.kinds.element,
      make("div", { class: "field" }, make("label", { for: "opacity" }, "Opacity of the colours"), this.opacity),
      make(
        "fieldset",
        { class: "field" },
        make("legend", {}, "Drawn over it"),
        ...this.boxes.map((box) => box.element),
      ),
      make("div", { class: "field" }, make("label", { for: "compare" }, "Swipe against"), this.compare),
    );
  }

  show(view: View): void {
    this.layers.show(view.layer);
    this.kinds.show(view.kind);
    this.overlays = view.overlays;
    for (const { overlay, input, element } of this.boxes) {
      input.checked = view.overlays.has(overlay);
      if (overlay === "changes") element.hidden = !this.able.changes || !view.compare;
      if (overlay === "frames") element.hidden = !this.joined;
    }
    this.opacity.value = String(view.opacity);
    this.opacity.setAttribute("aria-valuetext", `${Math.round(view.opacity * 100)} %`);
    this.compare.value = view.compare ?? "";
  }

  /** The maps there are to swipe against. */
  others(maps: MapRecord[], chosen: string | null): void {
    const option = (value: string, text: string) => make("option", { value }, text);
    const missing = chosen && !maps.some((map) => map.id === chosen) ? [option(chosen, chosen)] : [];
    this.compare.replaceChildren(
      option("", "no other map"),
      ...maps.map((map) => option(map.id, nameOf(map))),
      ...missing,
    );
    this.compare.value = chosen ?? "";
  }

  /** Offers the frames of a map that was joined. */
  offerFrames(): void {
    this.joined = true;
    for (const { overlay, element } of this.boxes) if (overlay === "frames") element.hidden = false;
  }

  /** Says something beside an overlay: loading, or why it is not there. */
  note(overlay: Overlay, text: string): void {
    const box = this.boxes.find((one) => one.overlay === overlay);
    if (box) box.note.textContent = text;
  }

  private toggle(overlay: Overlay, on: boolean): void {
    const overlays = new Set(this.overlays);
    if (on) overlays.add(overlay);
    else overlays.delete(overlay);
    this.wishes.go({ overlays });
  }
}

export function nameOf(map: MapRecord): string {
  return `${jobName(map)}, ${moment(map.created)}`;
}

function choice<T extends Layer | Kind>(title: string, name: string, values: T[], chosen: (value: T) => void) {
  const inputs = values.map((value) => make("input", { type: "radio", name, value, onchange: () => chosen(value) }));
  const labels = values.map((value, k) =>
    make("label", { class: "choice" }, inputs[k], make("span", {}, WORDS[value])),
  );
  const element = make(
    "fieldset",
    { class: "field" },
    make("legend", {}, title),
    make("div", { class: "choices" }, ...labels),
  );
  const show = (value: T) => inputs.forEach((input) => (input.checked = input.value === value));
  return { element, show };
}
