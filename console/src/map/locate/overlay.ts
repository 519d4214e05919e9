// Located scans on the map: their returns from the poses that were found, and the poses with their ellipses.

import { theme } from "../../kit/theme";
import { returnsOf } from "../../scan/returns";
import type { Pose, Scan } from "../../service/types";
import { PosesOverlay } from "../overlays/poses";
import { ReturnsOverlay } from "../overlays/returns";
import { inks } from "../palette";
import type { Located } from "./sighting";

export class LocatedOverlay {
  private readonly returns = new ReturnsOverlay(() => ({ ...inks(theme()), returns: inks(theme()).located }), 3);
  private readonly poses: PosesOverlay;

  constructor(enlarged: (times: number | null) => void) {
    this.poses = new PosesOverlay(() => ({ ...inks(theme()), poses: inks(theme()).place }), enlarged, true);
  }

  get layers() {
    return [this.returns.picture.layer, this.poses.picture.layer];
  }

  show(located: Located[]): void {
    const found = located.filter(({ found }) => found.pose !== null);
    const poses = found.map(({ found }) => found.pose as Pose);
    this.returns.set(
      returnsOf(
        found.map(({ scan }) => scan as Scan),
        poses,
      ),
    );
    this.poses.set(
      {
        treatment: "refined",
        poses: found.map(({ found: { covariance } }, k) => ({
          pose: poses[k] as Pose,
          covariance,
          posterior_covariance: covariance,
        })),
      },
      "propagated",
    );
  }

  /** In other colours: the theme changed. */
  renew(): void {
    this.returns.picture.renew();
    this.poses.picture.renew();
  }
}
