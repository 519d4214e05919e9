// The returns: what the lasers measured. Pixels are written by hand: a million of them take some milliseconds.

import type { Returns } from "../../scan/returns";
import type { Inks } from "../palette";
import { Picture, type Pen } from "../picture";

export class ReturnsOverlay {
  private returns: Returns | null = null;
  readonly picture: Picture;

  constructor(
    private readonly inks: () => Inks,
    zIndex = 1,
  ) {
    this.picture = new Picture((pen) => this.draw(pen), zIndex);
  }

  set(returns: Returns | null): void {
    this.returns = returns;
    this.picture.renew();
  }

  private draw({ context, width, height, extent, scale, density }: Pen): void {
    if (!this.returns || this.returns.points.length === 0) return;
    const image = context.createImageData(width, height);
    const pixels = new Uint32Array(image.data.buffer);
    const [r, g, b, a] = this.inks().returns;
    // Little-endian, as every machine with a browser is.
    const ink = ((a << 24) | (b << 16) | (g << 8) | r) >>> 0;
    const { points, origin } = this.returns;
    const [x0 = 0, , , y1 = 0] = extent;
    const left = (origin[0] - x0) * scale;
    const top = (y1 - origin[1]) * scale;
    // Never larger than 2 cm on the ground, unless that is less than a pixel.
    const side = Math.max(1, Math.round(Math.min(3 * density, 0.02 * scale)), Math.round(density));
    const half = side >> 1;
    for (let k = 0; k < points.length; k += 2) {
      const column = Math.round(left + (points[k] as number) * scale) - half;
      const row = Math.round(top - (points[k + 1] as number) * scale) - half;
      if (column < 0 || row < 0 || column + side > width || row + side > height) continue;
      for (let y = row; y < row + side; y += 1) {
        const start = y * width + column;
        pixels.fill(ink, start, start + side);
      }
    }
    context.putImageData(image, 0, 0);
  }
}
