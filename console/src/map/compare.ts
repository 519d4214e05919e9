// The other map of a swipe: brought in when it is wanted, taken away when it is not.

import { getMap } from "../service/maps";
import { Problem, isAbort } from "../service/problem";
import type { Canvas } from "./canvas";
import type { Scales } from "./scale";
import { Sheet, type SheetNews } from "./sheet";
import { Swipe } from "./swipe";
import type { View } from "./view";

export class Comparison {
  private other: { sheet: Sheet; swipe: Swipe } | null = null;
  private wanted: string | null = null;

  constructor(
    private readonly canvas: Canvas,
    private readonly own: Sheet,
    private readonly news: SheetNews,
    private readonly signal: AbortSignal,
    private readonly told: { moved(swipe: number): void; arrived(): void },
  ) {}

  get sheet(): Sheet | null {
    return this.other?.sheet ?? null;
  }

  /** Both maps in one scale of colours: else they could not be compared. */
  show(view: View, scales: Scales): void {
    if (view.compare !== this.wanted) void this.want(view.compare);
    this.other?.sheet.show(view, scales);
    this.other?.swipe.move(view.swipe);
  }

  private async want(id: string | null): Promise<void> {
    this.wanted = id;
    for (const layer of this.other?.sheet.layers ?? []) this.canvas.map.removeLayer(layer);
    this.other?.swipe.dispose();
    this.other = null;
    if (id === null) return;
    try {
      const record = await getMap(id, this.signal);
      if (this.wanted !== id) return;
      const sheet = new Sheet(record, this.news, this.signal);
      const swipe = new Swipe(this.canvas, this.told.moved);
      swipe.clip(this.own.layers, "left");
      swipe.clip(sheet.layers, "right");
      this.canvas.add(...sheet.layers);
      this.other = { sheet, swipe };
      this.told.arrived();
    } catch (error) {
      if (!isAbort(error)) this.news.failed(Problem.of(error));
    }
  }
}
