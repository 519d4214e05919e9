// Where a map comes from and what became of it: versions before and after, and the maps that were joined.

import { make } from "../kit/element";
import { coordinate, degrees, length } from "../kit/format";
import { jobName } from "../jobs/actions";
import { href } from "../route/address";
import type { Frame, MapRecord } from "../service/types";
import { type View, hrefOf } from "./view";

export class Lineage {
  readonly element = make("section", { class: "lineage", hidden: true }, make("h2", {}, "Lineage"));
  private readonly versions = make("ul", { "aria-label": "Versions" });
  private readonly frames = make("ol", { "aria-label": "Joined of" });

  constructor(private readonly record: MapRecord) {
    this.element.append(this.versions, this.frames);
  }

  /** The version before, and those after as far as they are among `others`; each to be opened or compared with. */
  showVersions(others: MapRecord[], view: View): void {
    const { record } = this;
    const named = (map: MapRecord) => `version ${map.version ?? 1}: ${jobName(map)}`;
    const rows: HTMLElement[] = [];
    if (record.parent) {
      const parent = others.find((map) => map.id === record.parent);
      const text = parent ? named(parent) : `version ${(record.version ?? 2) - 1}`;
      rows.push(this.row("Grown from ", record.parent, text, view));
    }
    for (const later of others.filter((map) => map.parent === record.id)) {
      rows.push(this.row("Grew into ", later.id, named(later), view));
    }
    this.versions.replaceChildren(...rows);
    this.reveal();
  }

  showFrames(frames: Frame[], others: MapRecord[]): void {
    this.frames.replaceChildren(
      ...frames.map(({ map_id, pose, covariance }, k) => {
        const map = others.find(({ id }) => id === map_id);
        const sigma = (k: number) => Math.sqrt(Math.max(0, covariance[4 * k] ?? 0));
        const held = sigma(0) === 0 && sigma(1) === 0;
        const spread = `σ ${length(sigma(0))}, ${length(sigma(1))}, ${((sigma(2) * 180) / Math.PI).toFixed(2)}°`;
        return make(
          "li",
          {},
          make("a", { href: href(["maps", map_id]) }, map ? jobName(map) : `map ${k + 1}`),
          make(
            "p",
            { class: "note" },
            `its frame at (${coordinate(pose.x)}, ${coordinate(pose.y)}) m, ${degrees(pose.theta)}; `,
            held ? "held" : spread,
          ),
        );
      }),
    );
    this.reveal();
  }

  private row(how: string, id: string, text: string, view: View): HTMLElement {
    const overlays = new Set(view.overlays).add("changes");
    // Seen beside it, with what changed between the two.
    const beside = hrefOf(this.record.id, { ...view, compare: id, overlays });
    return make(
      "li",
      {},
      how,
      make("a", { href: href(["maps", id]) }, text),
      " ",
      make("a", { class: "button small", href: beside, "aria-label": `Compare with ${text}` }, "Compare"),
    );
  }

  private reveal(): void {
    this.element.hidden = this.versions.childElementCount + this.frames.childElementCount === 0;
  }
}
