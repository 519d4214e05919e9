// The map on the screen: pan, zoom, where the pointer is, what was clicked; by pointer, touch or keyboard.

import Map from "ol/Map";
import View from "ol/View";
import { type Extent, getCenter, intersects } from "ol/extent";
import { defaults } from "ol/interaction/defaults";
import type BaseLayer from "ol/layer/Base";
import { make } from "../kit/element";
import { isStill } from "../kit/theme";
import type { Point } from "../service/types";
import { METRES, sizeOf } from "./space";
import type { Camera } from "./view";

/** Metres a pixel, at the finest. */
const FINEST = 0.0005;
const PADDING = 24;

/** A map is fitted beside what lies over the corner as long as it gets no smaller than by this. */
const SMALLER = 1.35;

/**
 * Space around a fitted extent (top, right, bottom, left), so that what covers the upper right corner covers none of it: to its
 * left or below it, whichever leaves the map larger.
 */
export function paddingBeside(corner: number[], view: number[], size: number[]): [number, number, number, number] {
  const [cornerWidth = 0, cornerHeight = 0] = corner;
  const [width = 1, height = 1] = view;
  const [w = 1, h = 1] = size;
  const resolution = (right: number, top: number) =>
    Math.max(w / (width - right - PADDING), h / (height - top - PADDING));
  const plain = resolution(PADDING, PADDING);
  const free = (width + w / plain) / 2 < width - cornerWidth || (height - h / plain) / 2 > cornerHeight;
  const beside = resolution(cornerWidth + PADDING, PADDING);
  const below = resolution(PADDING, cornerHeight + PADDING);
  const best = Math.min(beside, below);
  if (cornerWidth === 0 || free || !(best > 0) || best > SMALLER * plain) return [PADDING, PADDING, PADDING, PADDING];
  return beside < below
    ? [PADDING, cornerWidth + PADDING, PADDING, PADDING]
    : [cornerHeight + PADDING, PADDING, PADDING, PADDING];
}

export interface Watching {
  clicked?(point: Point): void;
  pointed?(point: Point | null): void;
  /** The view came to rest. */
  rested?(camera: Camera): void;
  /** The view moved, or is moving. */
  moved?(resolution: number): void;
}

export class Canvas {
  readonly map: Map;
  /** The element in the page; what is laid over the map goes in here. */
  readonly element: HTMLElement;
  private readonly target: HTMLElement;
  private readonly view: View;

  constructor(
    private readonly extent: Extent,
    label: string,
    watching: Watching,
    /** Width and height of what lies over the upper right corner, pixels. */
    private readonly corner: () => [number, number] = () => [0, 0],
  ) {
    this.target = make("div", {
      class: "map",
      tabindex: 0,
      role: "application",
      "aria-label": `${label}. Arrow keys pan, plus and minus zoom, Enter takes the point under the cross.`,
    });
    const cross = make("div", { class: "cross", "aria-hidden": "true" });
    this.element = make("div", { class: "canvas" }, this.target, cross);
    const [width, height] = sizeOf(extent);
    this.view = new View({
      projection: METRES,
      center: getCenter(extent),
      resolution: Math.max(width, height) / 600,
      minResolution: FINEST,
      maxResolution: Math.max(width, height, 1) / 60,
      enableRotation: false,
      constrainResolution: false,
    });
    const interactions = defaults({ altShiftDragRotate: false, pinchRotate: false, doubleClickZoom: false });
    this.map = new Map({
      target: this.target,
      view: this.view,
      controls: [],
      interactions,
      layers: [],
      maxTilesLoading: 6,
    });
    const pointAt = (coordinate: number[]): Point => [coordinate[0] ?? 0, coordinate[1] ?? 0];
    this.map.on("click", (event) => watching.clicked?.(pointAt(event.coordinate)));
    this.map.on("pointermove", (event) => event.dragging || watching.pointed?.(pointAt(event.coordinate)));
    this.target.addEventListener("pointerleave", () => watching.pointed?.(null));
    this.map.on("moveend", () => watching.rested?.(this.camera));
    this.view.on("change:resolution", () => watching.moved?.(this.view.getResolution() ?? 1));
    this.target.addEventListener("keydown", (event) => {
      if (event.key !== "Enter" && event.key !== " ") return;
      event.preventDefault();
      watching.clicked?.(this.camera.center);
    });
  }

  add(...layers: BaseLayer[]): void {
    for (const layer of layers) this.map.addLayer(layer);
  }

  get camera(): Camera {
    const [x = 0, y = 0] = this.view.getCenter() ?? [];
    return { center: [x, y], resolution: this.view.getResolution() ?? 1 };
  }

  /** Whether any of what there is lies in view. */
  get inView(): boolean {
    return intersects(this.view.calculateExtent(this.map.getSize()), this.extent);
  }

  /** Looks from there, or at the whole. */
  look(camera: Camera | null): void {
    if (!camera) return this.fit();
    const { center, resolution } = this.camera;
    const near = (a: number, b: number) => Math.abs(a - b) < 1e-3 * camera.resolution + 1e-3;
    // The address rounds: a view that is there already is left as it is.
    const same = near(center[0], camera.center[0]) && near(center[1], camera.center[1]);
    if (same && Math.abs(resolution / camera.resolution - 1) < 1e-3) return;
    this.view.setCenter(camera.center);
    this.view.setResolution(camera.resolution);
  }

  fit(): void {
    this.map.updateSize();
    const padding = paddingBeside(this.corner(), this.map.getSize() ?? [], sizeOf(this.extent));
    this.view.fit(this.extent, { padding, duration: 0 });
  }

  zoom(by: number): void {
    const zoom = (this.view.getZoom() ?? 0) + by;
    if (isStill()) this.view.setZoom(zoom);
    else this.view.animate({ zoom, duration: 180 });
  }

  render(): void {
    this.map.render();
  }

  dispose(): void {
    this.map.setTarget(undefined);
    this.map.dispose();
  }
}
