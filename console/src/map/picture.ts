// A layer that is drawn by hand on a canvas. OpenLayers moves the finished picture while one pans, and asks for a new one
// at rest: a hundred thousand returns cost nothing while the map moves. Each picture is drawn in a turn of its own, so that
// several do not hold the page up together.

import type { Extent } from "ol/extent";
import ImageLayer from "ol/layer/Image";
import ImageSource from "ol/source/Image";
import type { Point } from "../service/types";
import { METRES, sizeOf } from "./space";

/** Where and how large to draw. */
export interface Pen {
  context: CanvasRenderingContext2D;
  width: number;
  height: number;
  extent: Extent;
  /** Device pixels a metre. */
  scale: number;
  /** Device pixels a pixel of the page. */
  density: number;
  pixel(point: Point): [number, number];
}

/** A picture is so much larger than the view, each way: a short way is gone without a new one. */
const MARGIN = 0.2;

export class Picture {
  readonly layer: ImageLayer<ImageSource>;

  constructor(
    private readonly draw: (pen: Pen) => void,
    zIndex: number,
  ) {
    this.layer = new ImageLayer({ source: this.source(), zIndex });
  }

  /** Draws anew: what it shows has changed. */
  renew(): void {
    this.layer.setSource(this.source());
  }

  private source(): ImageSource {
    return new ImageSource({
      projection: METRES,
      loader: async (view, resolution, density) => {
        await new Promise((resolve) => setTimeout(resolve));
        const extent = grown(view);
        return { image: this.paint(extent, density / resolution, density), extent };
      },
    });
  }

  private paint(extent: Extent, scale: number, density: number): HTMLCanvasElement {
    const image = document.createElement("canvas");
    const [width, height] = sizeOf(extent).map((metres) => Math.max(1, Math.round(metres * scale))) as [number, number];
    image.width = width;
    image.height = height;
    const [x0 = 0, , , y1 = 0] = extent;
    const pixel = (point: Point): [number, number] => [(point[0] - x0) * scale, (y1 - point[1]) * scale];
    const context = image.getContext("2d");
    if (context) this.draw({ context, width, height, extent, scale, density, pixel });
    return image;
  }
}

function grown(extent: Extent): Extent {
  const [width, height] = sizeOf(extent);
  const [x0 = 0, y0 = 0, x1 = 0, y1 = 0] = extent;
  return [x0 - MARGIN * width, y0 - MARGIN * height, x1 + MARGIN * width, y1 + MARGIN * height];
}

/** Sets a pen so that paths in metres, relative to `origin`, land where they belong. */
export function inMetres(pen: Pen, origin: Point): void {
  const [x, y] = pen.pixel(origin);
  pen.context.setTransform(pen.scale, 0, 0, -pen.scale, x, y);
}
