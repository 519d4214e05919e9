// One map's layers: its colours, its contour. The page shows one sheet, or two beside a swipe's edge.

import type { Extent } from "ol/extent";
import { theme } from "../kit/theme";
import { getContours } from "../service/maps";
import { Problem, isAbort } from "../service/problem";
import type { MapRecord } from "../service/types";
import { Contour } from "./overlays/contour";
import { inks } from "./palette";
import type { Scales } from "./scale";
import { extentOf } from "./space";
import { Tiles } from "./tiles";
import type { View } from "./view";

export interface SheetNews {
  loading(count: number): void;
  failed(problem: Problem): void;
  /** What is still being fetched, beside tiles; null when it is there. */
  fetching(what: string | null): void;
}

export class Sheet {
  readonly extent: Extent;
  readonly tiles: Tiles;
  readonly contour: Contour;
  private asked = "";

  constructor(
    readonly record: MapRecord,
    private readonly news: SheetNews,
    private readonly signal: AbortSignal,
  ) {
    this.extent = extentOf(record.lattice);
    this.tiles = new Tiles(record.id, this.extent, news);
    this.contour = new Contour(record.lattice.origin, () => inks(theme()));
  }

  get layers() {
    return [this.tiles.layer, this.contour.picture.layer];
  }

  /** In other colours: the theme changed. */
  renew(): void {
    this.contour.picture.renew();
  }

  show(view: View, scales: Scales): void {
    this.tiles.show({ layer: view.layer, kind: view.kind, theme: theme(), max: scales[view.layer] });
    this.tiles.layer.setOpacity(view.opacity);
    const wanted = view.overlays.has("contour");
    this.contour.picture.layer.setVisible(wanted);
    if (wanted && this.asked !== view.kind) void this.fetchContour(view.kind);
  }

  private async fetchContour(kind: View["kind"]): Promise<void> {
    this.asked = kind;
    this.news.fetching("contour");
    try {
      const features = await getContours(this.record.id, kind, this.signal);
      if (this.asked === kind) this.contour.set(features);
    } catch (error) {
      if (isAbort(error)) return;
      this.asked = "";
      this.news.failed(Problem.of(error));
    } finally {
      this.news.fetching(null);
    }
  }
}
