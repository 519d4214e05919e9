// What is drawn over the colours on demand: returns, poses, changes. Each is fetched when it is first wanted.

import { theme } from "../kit/theme";
import { count } from "../kit/format";
import { type Features, getChanges } from "../service/maps";
import { Problem, isAbort } from "../service/problem";
import type { Frame, MapRecord } from "../service/types";
import { MapData } from "./data";
import { Changes } from "./overlays/changes";
import { PosesOverlay } from "./overlays/poses";
import { FramesOverlay } from "./overlays/frames";
import { ReturnsOverlay } from "./overlays/returns";
import { inks } from "./palette";
import type { Panel } from "./panel";
import type { Overlay, View } from "./view";

export class Extras {
  private readonly data: MapData;
  private readonly returns = new ReturnsOverlay(() => inks(theme()));
  private readonly poses: PosesOverlay;
  private readonly changes: Changes;
  private readonly frames = new FramesOverlay(() => inks(theme()));
  /** What each overlay was last asked for, so that nothing is asked twice. */
  private readonly asked = new Map<Overlay, string>();

  constructor(
    private readonly record: MapRecord,
    private readonly panel: Panel,
    private readonly signal: AbortSignal,
    enlarged: (times: number | null) => void,
  ) {
    this.data = new MapData(record, signal);
    this.poses = new PosesOverlay(() => inks(theme()), enlarged);
    this.changes = new Changes(record.lattice.origin, () => inks(theme()));
  }

  get layers() {
    return [this.returns, this.poses, this.changes, this.frames].map(({ picture }) => picture.layer);
  }

  /** In other colours: the theme changed. */
  renew(): void {
    for (const { picture } of [this.returns, this.poses, this.changes, this.frames]) picture.renew();
  }

  /** Where the maps that were joined lie. */
  setFrames(frames: Frame[]): void {
    this.frames.set(frames);
    this.panel.note("frames", String(frames.length));
  }

  show(view: View): void {
    const changes = view.overlays.has("changes") && view.compare !== null;
    this.returns.picture.layer.setVisible(view.overlays.has("returns"));
    this.poses.picture.layer.setVisible(view.overlays.has("poses"));
    this.changes.picture.layer.setVisible(changes);
    this.frames.picture.layer.setVisible(view.overlays.has("frames"));
    if (view.overlays.has("returns")) {
      void this.once("returns", "", async () => {
        const { returns, fitted } = await this.data.returns();
        this.returns.set(returns);
        return `${count(returns.points.length / 2)}${fitted ? "" : ", where the scans say they were"}`;
      });
    }
    if (view.overlays.has("poses")) {
      void this.once("poses", view.kind, async () => {
        const fitted = await this.data.poses();
        this.poses.set(fitted, view.kind);
        return `${count(fitted.poses.length)}${fitted.treatment === "fixed" ? ", fixed" : ""}`;
      });
    }
    if (changes && view.compare) {
      const since = view.compare;
      void this.once("changes", since, async () => {
        const found = await getChanges(this.record.id, since, this.signal);
        this.changes.set(found);
        return inWords(found);
      });
    }
  }

  /** Fetches once for one key, and says beside the box how it went. */
  private async once(overlay: Overlay, key: string, fetch: () => Promise<string>): Promise<void> {
    if (this.asked.get(overlay) === key) return;
    this.asked.set(overlay, key);
    this.panel.note(overlay, "loading…");
    try {
      this.panel.note(overlay, await fetch());
    } catch (error) {
      if (isAbort(error)) return;
      this.asked.delete(overlay);
      const problem = Problem.of(error);
      this.panel.note(overlay, `${problem.title}: ${problem.detail} Take the tick away and set it again to retry.`);
    }
  }
}

/** How much appeared and vanished. */
function inWords({ features }: Features): string {
  const parts = ["appeared", "vanished"].flatMap((role) => {
    const areas = features
      .filter(({ properties }) => properties.role === role)
      .map(({ properties }) => properties.area);
    const area = areas.reduce((sum: number, one) => sum + (one ?? 0), 0);
    return areas.length > 0 ? [`${count(areas.length)} ${role}, ${area.toFixed(2)} m²`] : [];
  });
  return parts.join("; ") || "none beyond both maps' uncertainty";
}
