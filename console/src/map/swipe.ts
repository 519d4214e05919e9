// Two maps, one on either side of an edge that can be moved.

import { unByKey } from "ol/Observable";
import type { EventsKey } from "ol/events";
import type BaseLayer from "ol/layer/Base";
import { getRenderPixel } from "ol/render";
import type RenderEvent from "ol/render/Event";
import { make } from "../kit/element";
import type { Canvas } from "./canvas";

type Side = "left" | "right";

export class Swipe {
  private at = 0.5;
  private readonly keys: EventsKey[] = [];
  private readonly edge = make("div", { class: "swipe-edge", "aria-hidden": "true" });
  private readonly handle = make("input", {
    type: "range",
    min: 0,
    max: 1,
    step: 0.01,
    class: "swipe",
    "aria-label": "Edge between the two maps",
  });
  readonly element = make("div", { class: "swipe-over" }, this.edge, this.handle);

  constructor(
    private readonly canvas: Canvas,
    settled: (at: number) => void,
  ) {
    this.handle.addEventListener("input", () => this.move(Number(this.handle.value)));
    this.handle.addEventListener("change", () => settled(Number(this.handle.value)));
    canvas.element.append(this.element);
  }

  move(at: number): void {
    this.at = at;
    this.handle.value = String(at);
    this.handle.setAttribute("aria-valuetext", `${Math.round(at * 100)} % from the left`);
    this.edge.style.left = `${at * 100}%`;
    this.canvas.render();
  }

  /** Draws layers on one side of the edge alone. */
  clip(layers: BaseLayer[], side: Side): void {
    for (const layer of layers) {
      const before = layer.on("prerender" as never, ((event: RenderEvent) => this.begin(event, side)) as never);
      const after = layer.on("postrender" as never, ((event: RenderEvent) => paper(event).restore()) as never);
      this.keys.push(before as EventsKey, after as EventsKey);
    }
  }

  dispose(): void {
    unByKey(this.keys);
    this.element.remove();
    this.canvas.render();
  }

  private begin(event: RenderEvent, side: Side): void {
    const [width = 0, height = 0] = this.canvas.map.getSize() ?? [];
    const [from, to] = side === "left" ? [0, width * this.at] : [width * this.at, width];
    const [x0 = 0, y0 = 0] = getRenderPixel(event, [from, 0]);
    const [x1 = 0, y1 = 0] = getRenderPixel(event, [to, height]);
    const context = paper(event);
    context.save();
    context.beginPath();
    context.rect(x0, y0, x1 - x0, y1 - y0);
    context.clip();
  }
}

function paper(event: RenderEvent): CanvasRenderingContext2D {
  return event.context as CanvasRenderingContext2D;
}
