// The scans before they are sent: their returns, the poses, and the lattice that is going to be laid over them. A recording is
// read by the service, which says where these lie.

import { containsExtent } from "ol/extent";
import { make } from "../kit/element";
import { onTheme, theme } from "../kit/theme";
import { Canvas } from "../map/canvas";
import { ReturnsOverlay } from "../map/overlays/returns";
import { inks } from "../map/palette";
import { Picture, type Pen } from "../map/picture";
import { ScaleBar, zoomButtons } from "../map/scalebar";
import { extentOf } from "../map/space";
import type { Estimate, Lattice, Point } from "../service/types";
import type { Summary } from "./reader";

export class Preview {
  readonly element = make("div", { class: "preview" });
  /** Beside the scans, where they are not read here. */
  private unread: string | null = null;
  private extent: number[] = [];
  private canvas: Canvas | null = null;
  private poses: Point[] = [];
  private lattice: Lattice | null = null;
  private readonly returns = new ReturnsOverlay(() => inks(theme()));
  private readonly frame = new Picture((pen) => this.draw(pen), 2);

  constructor(signal: AbortSignal) {
    onTheme(() => this.renew(), signal);
    signal.addEventListener("abort", () => this.canvas?.dispose());
  }

  /** Nothing yet: of another file, whose scans are shown next, or when the service has read them, as a sentence says. */
  clear(summary: Summary, unread: string | null): void {
    this.canvas?.dispose();
    this.canvas = null;
    this.hold(summary);
    this.unread = unread;
    this.lattice = null;
    this.element.replaceChildren();
  }

  /** Shows scans; fitted anew for another file, left as it is for another selection of the same. */
  show(summary: Summary, fit: boolean): void {
    this.hold(summary);
    if (fit || !this.canvas) this.open(summary.box ?? []);
    this.renew();
  }

  private hold({ poses, returns }: Summary): void {
    this.poses = poses.map(({ x, y }) => [x, y]);
    this.returns.set(returns);
  }

  /** Shows what the service has read of a recording. */
  showRead({ returns, poses }: NonNullable<Estimate["preview"]>): void {
    const [origin = [0, 0]] = returns;
    const points = Float32Array.from(returns.flatMap(([x, y]) => [x - origin[0], y - origin[1]]));
    this.returns.set({ origin, points });
    this.poses = poses;
    this.renew();
  }

  showLattice(lattice: Lattice | null): void {
    // Without scans the lattice is what is looked at; it is looked at anew where it has grown out of view.
    const extent = lattice && this.unread ? extentOf(lattice) : null;
    if (extent && !(this.canvas && containsExtent(this.extent, extent))) this.open(extent);
    this.lattice = lattice;
    this.frame.renew();
  }

  private open([x0 = -1, y0 = -1, x1 = 1, y1 = 1]: number[]): void {
    this.canvas?.dispose();
    this.lattice = null;
    const bar = new ScaleBar();
    const margin = 0.06 * Math.max(x1 - x0, y1 - y0, 1);
    this.extent = [x0 - margin, y0 - margin, x1 + margin, y1 + margin];
    const canvas = new Canvas(
      this.extent,
      this.unread ? "The lattice to be laid, and the returns" : "The returns to be sent",
      { pointed: (point) => bar.point(point), moved: (resolution) => bar.show(resolution) },
    );
    canvas.add(this.returns.picture.layer, this.frame.layer);
    canvas.element.append(zoomButtons(canvas), bar.element);
    this.element.replaceChildren(canvas.element, ...(this.unread ? [make("p", { class: "note" }, this.unread)] : []));
    this.canvas = canvas;
    // The element may not be laid out yet.
    requestAnimationFrame(() => {
      canvas.fit();
      bar.show(canvas.camera.resolution);
    });
  }

  private renew(): void {
    this.returns.picture.renew();
    this.frame.renew();
  }

  private draw({ context, density, scale, pixel }: Pen): void {
    const { poses: ink, contour } = inks(theme());
    context.fillStyle = ink;
    for (const pose of this.poses) {
      const [x, y] = pixel(pose);
      context.fillRect(x - density, y - density, 2 * density, 2 * density);
    }
    if (!this.lattice) return;
    const [x0 = 0, y0 = 0, x1 = 0, y1 = 0] = extentOf(this.lattice);
    const [left, bottom] = pixel([x0, y0]);
    context.strokeStyle = contour;
    context.lineWidth = 1.5 * density;
    context.setLineDash([6 * density, 4 * density]);
    context.strokeRect(left, bottom - (y1 - y0) * scale, (x1 - x0) * scale, (y1 - y0) * scale);
    context.setLineDash([]);
  }
}
