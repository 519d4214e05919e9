// Where the maps that were joined have their frames: an origin and two axes each, with the number it has in the list.

import type { Frame } from "../../service/types";
import type { Inks } from "../palette";
import { Picture, type Pen } from "../picture";

/** Axes are so long, pixels. */
const AXIS = 34;

export class FramesOverlay {
  private frames: Frame[] = [];
  readonly picture = new Picture((pen) => this.draw(pen), 5);

  constructor(private readonly inks: () => Inks) {}

  set(frames: Frame[]): void {
    this.frames = frames;
    this.picture.renew();
  }

  private draw({ context, density, pixel }: Pen): void {
    const { mark, halo } = this.inks();
    context.lineCap = "round";
    context.font = `600 ${13 * density}px system-ui, sans-serif`;
    this.frames.forEach(({ pose }, k) => {
      const [x, y] = pixel([pose.x, pose.y]);
      const tip = (turn: number): [number, number] => [
        x + AXIS * density * Math.cos(pose.theta + turn),
        y - AXIS * density * Math.sin(pose.theta + turn),
      ];
      for (const [ink, width] of [[halo, 5] as const, [mark, 2] as const]) {
        context.strokeStyle = ink;
        context.lineWidth = width * density;
        context.beginPath();
        for (const [tx, ty] of [tip(0), tip(Math.PI / 2)]) {
          context.moveTo(x, y);
          context.lineTo(tx, ty);
        }
        context.stroke();
      }
      const [lx, ly] = tip(0);
      context.lineWidth = 3 * density;
      context.strokeStyle = halo;
      context.fillStyle = mark;
      const text = `${k + 1} x`;
      context.strokeText(text, lx + 5 * density, ly + 4 * density);
      context.fillText(text, lx + 5 * density, ly + 4 * density);
    });
  }
}
