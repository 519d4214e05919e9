// The map and what lies beside it. The view is the address's: controls change the address, and the address the view.

import { downloadList } from "../kit/downloads";
import { make, write } from "../kit/element";
import { onTheme, theme } from "../kit/theme";
import { jobName } from "../jobs/actions";
import { heading } from "../route/router";
import type { Abilities } from "../service/abilities";
import { getFrames, listMaps } from "../service/maps";
import { Problem, isAbort } from "../service/problem";
import type { Frame, MapRecord, Point } from "../service/types";
import { AnswerPanel, brief } from "./answer";
import { Canvas } from "./canvas";
import { Comparison } from "./compare";
import { Extras } from "./extras";
import { facts } from "./facts";
import { filesOf } from "./files";
import { Legend } from "./legend";
import { Lineage } from "./lineage";
import { LocatedOverlay } from "./locate/overlay";
import { LocatePanel } from "./locate/panel";
import type { Located } from "./locate/sighting";
import { MarksOverlay } from "./overlays/marks";
import { inks } from "./palette";
import { Panel } from "./panel";
import { Ruler } from "./ruler";
import { type Scales, scalesOf } from "./scale";
import { ScaleBar, zoomButtons } from "./scalebar";
import { Sheet } from "./sheet";
import { State } from "./state";
import { type Camera, type View, hrefOf } from "./view";

export class MapView {
  readonly element = make("div", { class: "map-view" });
  private readonly state = new State(
    () => this.again(),
    (tiles) => (this.element.dataset["tiles"] = String(tiles)),
  );
  private readonly canvas: Canvas;
  private readonly sheet: Sheet;
  private readonly extras: Extras;
  private readonly comparison: Comparison;
  private readonly marks = new MarksOverlay(() => inks(theme()));
  private readonly ruler = new Ruler(this.marks, (ruler) => this.go({ ruler }));
  private readonly legend = new Legend();
  private readonly scaleBar = new ScaleBar();
  private readonly panel: Panel;
  private readonly answer: AnswerPanel;
  private readonly downloads = make("div", {});
  /** The answer again, where the panel lies below the screen's edge; read out is the panel's. */
  private readonly readout = make("p", { class: "readout", "aria-hidden": "true" });
  private readonly lineage: Lineage;
  private readonly located: LocatedOverlay;
  private readonly locate: LocatePanel | null;
  private scales: Scales | null = null;
  /** How much larger than life ellipses are drawn: of the map's poses, of located scans. */
  private readonly enlarged: { poses: number | null; located: number | null } = { poses: null, located: null };
  private others: MapRecord[] = [];
  private frames: Frame[] = [];

  constructor(
    private readonly record: MapRecord,
    private readonly able: Abilities | null,
    private view: View,
    private readonly signal: AbortSignal,
  ) {
    const go = (change: Partial<View>) => this.go(change);
    this.sheet = new Sheet(record, this.state, signal);
    const watching = {
      clicked: (point: Point) => this.clicked(point),
      pointed: (point: Point | null) => this.scaleBar.point(point),
      rested: (camera: Camera) => this.rested(camera),
      moved: (resolution: number) => this.scaleBar.show(resolution),
    };
    this.canvas = new Canvas(this.sheet.extent, `Map ${jobName(record)}`, watching, () => this.legend.covers());
    this.answer = new AnswerPanel(
      record.id,
      (answer) => {
        this.marks.point(answer);
        write(this.readout, answer ? brief(answer) : "");
      },
      () => go({ at: null }),
    );
    const changes = able?.has("get", "/v1/maps/{id}/changes") ?? false;
    this.panel = new Panel({ go, opacity: (opacity) => this.fade(opacity) }, { changes });
    const enlarged = (what: "poses" | "located") => (times: number | null) => {
      this.enlarged[what] = times;
      this.showLegend();
    };
    this.extras = new Extras(record, this.panel, signal, enlarged("poses"));
    this.lineage = new Lineage(record);
    this.located = new LocatedOverlay(enlarged("located"));
    const wishes = {
      draw: (located: Located[]) => this.located.show(located),
      look: (at: Point) => this.canvas.look({ ...this.canvas.camera, center: at }),
      kind: () => this.view.kind,
    };
    const locates = able?.has("post", "/v1/maps/{id}/localize") ?? false;
    this.locate = locates ? new LocatePanel(record.id, wishes, signal) : null;
    this.comparison = new Comparison(this.canvas, this.sheet, this.state, signal, {
      moved: (swipe) => go({ swipe }),
      arrived: () => this.show(),
    });
    this.canvas.add(...this.sheet.layers, ...this.extras.layers, ...this.located.layers, this.marks.picture.layer);
    this.lay();
    onTheme(() => this.renew(), signal);
  }

  /** Once it is in the page: a map needs its size to be fitted. */
  begin(): void {
    this.canvas.look(this.view.camera);
    this.scaleBar.show(this.canvas.camera.resolution);
    void this.chooseScales();
    void this.listOthers();
    void this.listFrames();
    this.show();
  }

  update(view: View): void {
    // Back to where no view was named is back to the whole map.
    if (JSON.stringify(view.camera) !== JSON.stringify(this.view.camera)) this.canvas.look(view.camera);
    this.view = view;
    this.show();
  }

  dispose(): void {
    this.canvas.dispose();
  }

  /** What lies over the map, and what stands beside it. */
  private lay(): void {
    const { canvas, legend, record } = this;
    const over = [
      zoomButtons(canvas),
      this.ruler.tools.element,
      this.scaleBar.element,
      this.readout,
      this.state.element,
    ];
    canvas.element.append(...over);
    const section = (title: string, ...content: HTMLElement[]) =>
      make("section", {}, make("h2", {}, title), ...content);
    this.element.append(
      make("div", { class: "stage" }, canvas.element, legend.element),
      make(
        "div",
        { class: "side" },
        heading(jobName(record)),
        facts(record),
        section("Point", this.answer.element, this.ruler.element),
        section("View", this.panel.element),
        this.lineage.element,
        ...(this.locate ? [section("Locate scans", this.locate.element)] : []),
        section("Downloads", this.downloads),
      ),
    );
  }

  /** The address follows, and tells everybody later: what comes to rest meanwhile must not take this back. */
  private go(change: Partial<View>): void {
    this.view = { ...this.view, camera: this.canvas.camera, ...change };
    location.hash = hrefOf(this.record.id, this.view);
  }

  /** The view came to rest: the address follows, but moving about is no step to go back over. */
  private rested(camera: View["camera"]): void {
    if (this.signal.aborted) return;
    this.view = { ...this.view, camera };
    history.replaceState(null, "", hrefOf(this.record.id, this.view));
    this.sayWhyEmpty();
  }

  private clicked(point: Point): void {
    if (!this.ruler.takes(point)) this.go({ at: point });
  }

  private sayWhyEmpty(): void {
    const { opacity, overlays, compare } = this.view;
    const shown = opacity > 0 || [...overlays].some((one) => one !== "changes" || compare !== null);
    if (!this.canvas.inView) {
      this.state.empty({
        title: "The map is out of view",
        detail: "Everything that was scanned lies elsewhere.",
        step: "Show the whole map",
        act: () => this.canvas.fit(),
      });
    } else if (!shown) {
      this.state.empty({
        title: "Everything is hidden",
        detail: "The colours are transparent, and nothing is drawn over them.",
        step: "Show the colours",
        act: () => this.go({ opacity: 1 }),
      });
    } else {
      this.state.empty(null);
    }
  }

  private fade(opacity: number): void {
    for (const sheet of [this.sheet, this.comparison.sheet]) sheet?.tiles.layer.setOpacity(opacity);
  }

  private async chooseScales(): Promise<void> {
    try {
      this.scales = await scalesOf(this.record.id, this.sheet.extent, this.view.kind, this.signal);
      this.show();
    } catch (error) {
      if (!isAbort(error)) this.state.failed(Problem.of(error));
    }
  }

  private async listOthers(): Promise<void> {
    const page = await listMaps({ limit: 200 }, this.signal).catch(() => null);
    const others = page?.items.filter((map) => map.id !== this.record.id);
    if (!others) return;
    this.others = others;
    this.panel.others(others, this.view.compare);
    this.lineage.showVersions(others, this.view);
    this.lineage.showFrames(this.frames, others);
  }

  /** Only a map that was joined has any. */
  private async listFrames(): Promise<void> {
    if (!this.able?.has("get", "/v1/maps/{id}/frames")) return;
    const frames = await getFrames(this.record.id, this.signal).then(
      ({ frames }) => frames,
      () => [],
    );
    if (frames.length === 0) return;
    this.frames = frames;
    this.panel.offerFrames();
    this.extras.setFrames(frames);
    this.lineage.showFrames(frames, this.others);
    this.listDownloads();
  }

  /** In other colours: tiles have their theme in their address, what is drawn here is drawn anew. */
  private renew(): void {
    for (const part of [this.sheet, this.comparison.sheet, this.extras, this.located]) part?.renew();
    this.marks.picture.renew();
    this.show();
  }

  /** Asks anew for what failed. */
  private again(): void {
    this.sheet.tiles.again();
    this.comparison.sheet?.tiles.again();
    if (this.scales) this.show();
    else void this.chooseScales();
  }

  private show(): void {
    const { view } = this;
    this.panel.show(view);
    this.extras.show(view);
    this.sayWhyEmpty();
    this.lineage.showVersions(this.others, view);
    this.listDownloads();
    if (view.at) void this.answer.ask(view.at, view.kind);
    else this.answer.clear();
    this.ruler.show(view.ruler);
    if (!this.scales) return;
    this.sheet.show(view, this.scales);
    this.comparison.show(view, this.scales);
    this.showLegend();
  }

  private showLegend(): void {
    if (!this.scales) return;
    const { layer, kind, compare } = this.view;
    const { distance } = this.record;
    const there = { changes: compare !== null, frames: this.frames.length > 0 };
    const overlays = new Set([...this.view.overlays].filter((one) => (there as Record<string, boolean>)[one] ?? true));
    const { poses: enlarged, located } = this.enlarged;
    this.legend.show({ layer, kind, overlays, distance, max: this.scales[layer], enlarged, located });
  }

  /** Made anew only where addresses change, so that what is unfolded stays so. */
  private listDownloads(): void {
    const { kind, compare } = this.view;
    const wanted = { kind, since: compare, joined: this.frames.length > 0 };
    if (this.downloads.dataset["of"] === JSON.stringify(wanted)) return;
    this.downloads.dataset["of"] = JSON.stringify(wanted);
    this.downloads.replaceChildren(downloadList(filesOf(this.record, wanted, this.able)));
  }
}
