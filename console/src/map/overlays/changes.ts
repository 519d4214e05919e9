// What appeared and vanished between two maps, beyond what both maps' uncertainty explains.

import type { Features } from "../../service/maps";
import type { Point } from "../../service/types";
import type { Inks } from "../palette";
import { Picture, type Pen, inMetres } from "../picture";
import { pathOf } from "./geometry";

export class Changes {
  private appeared: Path2D[] = [];
  private vanished: Path2D[] = [];
  readonly picture = new Picture((pen) => this.draw(pen), 3);

  constructor(
    private readonly origin: Point,
    private readonly inks: () => Inks,
  ) {}

  set(features: Features): void {
    const paths = (role: string) =>
      features.features.filter((one) => one.properties.role === role).map((one) => pathOf(one.geometry, this.origin));
    this.appeared = paths("appeared");
    this.vanished = paths("vanished");
    this.picture.renew();
  }

  private draw(pen: Pen): void {
    inMetres(pen, this.origin);
    pen.context.fillStyle = this.inks().appeared;
    for (const path of this.appeared) pen.context.fill(path, "evenodd");
    pen.context.fillStyle = this.inks().vanished;
    for (const path of this.vanished) pen.context.fill(path, "evenodd");
  }
}
