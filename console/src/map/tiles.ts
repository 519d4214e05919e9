// The coloured layer: tiles of the service, fetched by view. Fetched by hand, so that a key can be sent and a refusal read;
// decoded off the page's thread, so that panning does not wait for pictures.

import type { Extent } from "ol/extent";
import TileLayer from "ol/layer/Tile";
import ImageTileSource, { type Options } from "ol/source/ImageTile";
import { isStill } from "../kit/theme";
import { request } from "../service/client";
import { type TileStyle, tilePath } from "../service/maps";
import { Problem, isAbort } from "../service/problem";
import { METRES, rowUpwards, tileGrid } from "./space";

export interface TileNews {
  /** Tiles under way; none when the view is complete. */
  loading(count: number): void;
  failed(problem: Problem): void;
}

/**
 * A source with a key of its own. OpenLayers' queue knows tiles by key and place: without one, a tile of another map or style, or
 * one that failed, stands in the way of this one.
 */
class OwnTiles extends ImageTileSource {
  private static made = 0;

  constructor(options: Options) {
    super(options);
    OwnTiles.made += 1;
    this.setKey(String(OwnTiles.made));
  }
}

export class Tiles {
  readonly layer = new TileLayer<ImageTileSource>({ zIndex: 0, preload: 0 });
  private style: TileStyle | null = null;
  private underWay = 0;

  constructor(
    private readonly id: string,
    private readonly extent: Extent,
    private readonly news: TileNews,
  ) {}

  show(style: TileStyle): void {
    if (JSON.stringify(style) === JSON.stringify(this.style)) return;
    this.style = style;
    this.layer.setSource(this.source(style));
  }

  /** Asks again for what failed; a source that is only refreshed may keep its failures. */
  again(): void {
    if (this.style) this.layer.setSource(this.source(this.style));
  }

  private source(style: TileStyle): ImageTileSource {
    return new OwnTiles({
      projection: METRES,
      tileGrid: tileGrid(this.extent),
      wrapX: false,
      transition: isStill() ? 0 : 150,
      loader: async (z, x, row, { signal }) => {
        this.count(1);
        try {
          const path = tilePath(this.id, style, z, x, rowUpwards(row));
          const response = await request(path, { signal, headers: { accept: "image/png" } });
          return await createImageBitmap(await response.blob());
        } catch (error) {
          if (!isAbort(error)) this.news.failed(Problem.of(error));
          throw error;
        } finally {
          this.count(-1);
        }
      },
    });
  }

  private count(change: number): void {
    this.underWay += change;
    this.news.loading(this.underWay);
  }
}
