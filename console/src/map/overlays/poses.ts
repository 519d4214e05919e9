// Where the scans were taken, which way they looked, and how uncertain that is.

import type { FittedPoses, Kind, Point } from "../../service/types";
import type { Inks } from "../palette";
import { Picture, type Pen } from "../picture";

/** An ellipse of so many standard deviations. */
const SIGMAS = 2;
/** Ellipses that would be smaller than this, in pixels, are drawn so many times as large. */
const LEGIBLE = 5;
const ENLARGED = [1, 2, 5, 10, 20, 50, 100];

export interface Ellipse {
  /** Half axes, metres, and the first one's direction. */
  major: number;
  minor: number;
  turn: number;
}

/** The ellipse of one standard deviation of x and y, of a covariance row-major in (x, y, theta). */
export function ellipseOf(covariance: number[]): Ellipse {
  const [xx = 0, xy = 0, , , yy = 0] = covariance;
  const mean = (xx + yy) / 2;
  const spread = Math.hypot((xx - yy) / 2, xy);
  return {
    major: Math.sqrt(Math.max(0, mean + spread)),
    minor: Math.sqrt(Math.max(0, mean - spread)),
    turn: Math.atan2(2 * xy, xx - yy) / 2,
  };
}

export class PosesOverlay {
  private poses: { at: Point; theta: number; ellipse: Ellipse | null }[] = [];
  private typical = 0;
  readonly picture: Picture;

  constructor(
    private readonly inks: () => Inks,
    /** Told how much larger than life ellipses are drawn; null without any. */
    private readonly enlarged: (times: number | null) => void,
    /** Few poses that matter more than those of the fit. */
    private readonly bold = false,
  ) {
    this.picture = new Picture((pen) => this.draw(pen), bold ? 5 : 4);
  }

  set(fitted: FittedPoses, kind: Kind): void {
    this.poses = fitted.poses.map(({ pose, covariance, posterior_covariance }) => {
      const wanted = kind === "posterior" ? posterior_covariance : covariance;
      return { at: [pose.x, pose.y], theta: pose.theta, ellipse: wanted ? ellipseOf(wanted) : null };
    });
    const majors = this.poses.flatMap(({ ellipse }) => (ellipse ? [ellipse.major] : [])).sort((a, b) => a - b);
    this.typical = majors[Math.floor(majors.length / 2)] ?? 0;
    this.picture.renew();
  }

  private draw({ context, width, height, scale, density, pixel }: Pen): void {
    const legible = (times: number) => SIGMAS * this.typical * times * scale >= LEGIBLE * density;
    const times = ENLARGED.find(legible) ?? 100;
    this.enlarged(this.typical > 0 ? times : null);
    const seen = this.poses
      .map((pose) => ({ ...pose, pixel: pixel(pose.at) }))
      .filter(({ pixel: [x, y] }) => x > -50 && y > -50 && x < width + 50 && y < height + 50);
    context.strokeStyle = this.inks().poses;
    context.fillStyle = this.inks().poses;
    context.lineWidth = (this.bold ? 2 : 1) * density;
    // Poses never bury the map: where they crowd they are thin.
    const crowded = seen.length > 400;
    context.globalAlpha = crowded ? 0.55 : 0.9;
    const tick = (crowded ? 6 : this.bold ? 13 : 9) * density;
    // One path for all dots and one for all lines: a thousand of them would take ten times as long.
    const radius = (crowded ? 1.4 : this.bold ? 3.2 : 2.2) * density;
    context.beginPath();
    for (const {
      pixel: [x, y],
    } of seen) {
      context.moveTo(x + radius, y);
      context.arc(x, y, radius, 0, 2 * Math.PI);
    }
    context.fill();
    context.beginPath();
    for (const {
      pixel: [x, y],
      theta,
      ellipse,
    } of seen) {
      context.moveTo(x, y);
      context.lineTo(x + tick * Math.cos(theta), y - tick * Math.sin(theta));
      if (ellipse) {
        const grown = SIGMAS * times * scale;
        context.moveTo(
          x + ellipse.major * grown * Math.cos(ellipse.turn),
          y - ellipse.major * grown * Math.sin(ellipse.turn),
        );
        context.ellipse(x, y, ellipse.major * grown, ellipse.minor * grown, -ellipse.turn, 0, 2 * Math.PI);
      }
    }
    context.stroke();
  }
}
