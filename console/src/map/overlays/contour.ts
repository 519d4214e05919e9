// The surfaces as the map has them, and the band in which they lie within two standard deviations.

import type { Features } from "../../service/maps";
import type { Point } from "../../service/types";
import type { Inks } from "../palette";
import { Picture, type Pen, inMetres } from "../picture";
import { pathOf } from "./geometry";

export class Contour {
  private level: Path2D[] = [];
  private band: Path2D[] = [];
  readonly picture = new Picture((pen) => this.draw(pen), 2);

  constructor(
    private readonly origin: Point,
    private readonly inks: () => Inks,
  ) {}

  set(features: Features): void {
    const paths = (role: string) =>
      features.features.filter((one) => one.properties.role === role).map((one) => pathOf(one.geometry, this.origin));
    this.level = paths("level");
    this.band = paths("band");
    this.picture.renew();
  }

  private draw(pen: Pen): void {
    const { context, scale, density } = pen;
    inMetres(pen, this.origin);
    context.fillStyle = this.inks().band;
    for (const path of this.band) context.fill(path, "evenodd");
    context.lineJoin = "round";
    // With a rim: no scale of colours lacks the line's own.
    for (const [ink, width] of [[this.inks().rim, 3.2] as const, [this.inks().contour, 1.4] as const]) {
      context.strokeStyle = ink;
      context.lineWidth = (width * density) / scale;
      for (const path of this.level) context.stroke(path);
    }
  }
}
