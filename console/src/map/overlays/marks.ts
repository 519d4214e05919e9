// The point asked about, with the surface it is nearest to and the gradient; and the ruler.

import type { Point } from "../../service/types";
import type { Inks } from "../palette";
import { Picture, type Pen } from "../picture";

export interface Marks {
  at: Point | null;
  nearest: Point | null;
  gradient: Point | null;
  ruler: [Point, Point | null] | null;
}

export class MarksOverlay {
  private marks: Marks = { at: null, nearest: null, gradient: null, ruler: null };
  readonly picture = new Picture((pen) => this.draw(pen), 6);

  constructor(private readonly inks: () => Inks) {}

  /** The point asked about; none where there is no answer. */
  point(answer: Pick<Marks, "at" | "nearest" | "gradient"> | null): void {
    const { at = null, nearest = null, gradient = null } = answer ?? {};
    this.set({ at, nearest, gradient });
  }

  set(change: Partial<Marks>): void {
    const marks = { ...this.marks, ...change };
    if (JSON.stringify(marks) === JSON.stringify(this.marks)) return;
    this.marks = marks;
    this.picture.renew();
  }

  private draw(pen: Pen): void {
    const { at, nearest, gradient, ruler } = this.marks;
    if (at && nearest) this.line(pen, [at, nearest], 2, [6, 4]);
    if (at && gradient) this.arrow(pen, at, gradient);
    if (nearest) this.dot(pen, nearest, 3.5, false);
    if (at) this.dot(pen, at, 5, true);
    if (ruler?.[1]) this.line(pen, [ruler[0], ruler[1]], 2, []);
    for (const end of ruler ?? []) if (end) this.dot(pen, end, 4, false);
  }

  /** Drawn twice: wide and pale first, so that it shows on every colour. */
  private twice(pen: Pen, width: number, draw: () => void): void {
    const { context, density } = pen;
    const { mark, halo } = this.inks();
    for (const [ink, wider] of [[halo, 3] as const, [mark, 0] as const]) {
      context.strokeStyle = ink;
      context.lineWidth = (width + wider) * density;
      draw();
    }
  }

  private line(pen: Pen, points: [Point, Point], width: number, dash: number[]): void {
    const { context, density, pixel } = pen;
    context.lineCap = "round";
    this.twice(pen, width, () => {
      context.setLineDash(context.strokeStyle === this.inks().halo ? [] : dash.map((one) => one * density));
      context.beginPath();
      context.moveTo(...pixel(points[0]));
      context.lineTo(...pixel(points[1]));
      context.stroke();
    });
    context.setLineDash([]);
  }

  /** A gradient of length one is 40 pixels long. */
  private arrow(pen: Pen, at: Point, [gx, gy]: Point): void {
    const { context, density, pixel } = pen;
    const [x, y] = pixel(at);
    const reach = 40 * density;
    const [tx, ty] = [x + gx * reach, y - gy * reach];
    const turn = Math.atan2(ty - y, tx - x);
    this.twice(pen, 2, () => {
      context.beginPath();
      context.moveTo(x, y);
      context.lineTo(tx, ty);
      for (const side of [-1, 1]) {
        context.moveTo(tx, ty);
        context.lineTo(tx - 8 * density * Math.cos(turn + 0.5 * side), ty - 8 * density * Math.sin(turn + 0.5 * side));
      }
      context.stroke();
    });
  }

  private dot(pen: Pen, at: Point, radius: number, hollow: boolean): void {
    const { context, density, pixel } = pen;
    const [x, y] = pixel(at);
    context.beginPath();
    context.arc(x, y, radius * density, 0, 2 * Math.PI);
    context.fillStyle = hollow ? this.inks().halo : this.inks().mark;
    this.twice(pen, 1.5, () => context.stroke());
    context.fill();
  }
}
