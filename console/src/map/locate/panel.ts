// Where were these scans taken? A file is dropped, some of its scans are asked about, and drawn where the map has them.

import { dropZone } from "../../kit/drop";
import { make, write } from "../../kit/element";
import { counted } from "../../kit/format";
import { notice, problemNotice } from "../../kit/notice";
import { localize } from "../../service/maps";
import { isAbort } from "../../service/problem";
import type { Kind, Point } from "../../service/types";
import { locatedRow } from "./list";
import { type Picked, pickScans } from "./scans";
import { type Located, type Prior, sightings } from "./sighting";

export interface Wishes {
  /** Draws what was found so far. */
  draw(located: Located[]): void;
  look(at: Point): void;
  /** The kind of the map's covariance that is looked at. */
  kind(): Kind;
}

export class LocatePanel {
  private readonly near = radio("near", "Near the file's poses", true);
  private readonly anywhere = radio("anywhere", "Anywhere on the map", false);
  private readonly position = number("locate-position", 0.2, 0.001, "any");
  private readonly heading = number("locate-heading", 0.1, 0.001, "any");
  private readonly most = number("locate-most", 10, 1, 1);
  private readonly state = make("p", { role: "status" });
  private readonly trouble = make("div", {});
  private readonly list = make("ul", { class: "located", "aria-label": "Located scans" });
  private readonly again = button("Locate again", () => void this.run());
  private readonly clear = button("Clear the scans", () => this.forget());
  private readonly actions = make("p", { class: "actions", hidden: true }, this.again, this.clear);
  private file: File | null = null;
  private asking = new AbortController();
  private located: Located[] = [];
  readonly element: HTMLElement;

  constructor(
    private readonly id: string,
    private readonly wishes: Wishes,
    private readonly signal: AbortSignal,
  ) {
    const sigma = (label: string, input: HTMLInputElement) =>
      make("div", { class: "form-field" }, make("label", { for: input.id }, label), input);
    const sigmas = make(
      "div",
      { class: "locate-numbers" },
      sigma("σ position, m", this.position),
      sigma("σ heading, rad", this.heading),
    );
    const choose = () => (sigmas.hidden = this.anywhere.input.checked);
    for (const { input } of [this.near, this.anywhere]) input.addEventListener("change", choose);
    this.element = make(
      "div",
      { class: "locate" },
      make(
        "fieldset",
        { class: "field" },
        make("legend", {}, "Where to look"),
        this.near.element,
        sigmas,
        this.anywhere.element,
      ),
      make("div", { class: "locate-numbers" }, sigma("Scans at most", this.most)),
      dropZone(
        ".json,.log,.clf,.txt,.gz",
        ["Scans of a job as JSON or of a CARMEN log, either gzipped or not."],
        (file) => void this.take(file),
        signal,
      ),
      this.state,
      this.actions,
      this.trouble,
      this.list,
    );
    signal.addEventListener("abort", () => this.asking.abort());
  }

  private take(file: File): void {
    this.file = file;
    this.element.scrollIntoView({ block: "nearest" });
    void this.run();
  }

  private forget(): void {
    this.asking.abort();
    this.file = null;
    this.located = [];
    this.list.replaceChildren();
    this.trouble.replaceChildren();
    this.actions.hidden = true;
    write(this.state, "");
    this.wishes.draw([]);
    this.element.querySelector<HTMLElement>("#file")?.focus();
  }

  private prior(): Prior {
    const positive = (input: HTMLInputElement) => Math.max(1e-4, Number(input.value) || 0);
    const sigma = { position: positive(this.position), heading: positive(this.heading) };
    return { sigma: this.near.input.checked ? sigma : null };
  }

  private async run(): Promise<void> {
    const { file } = this;
    if (!file) return;
    this.asking.abort();
    const asking = new AbortController();
    this.asking = asking;
    this.located = [];
    this.list.replaceChildren();
    this.trouble.replaceChildren();
    this.actions.hidden = false;
    this.wishes.draw([]);
    write(this.state, `Reading ${file.name}…`);
    let picked: Picked;
    try {
      picked = await pickScans(file, Number(this.most.value), asking.signal);
    } catch (error) {
      if (isAbort(error)) return;
      write(this.state, "");
      const detail = (error as Error).message;
      this.trouble.replaceChildren(
        notice({ title: `The scans of ${file.name} cannot be located`, detail, role: "alert" }),
      );
      return;
    }
    try {
      await this.ask(picked, file.name, AbortSignal.any([asking.signal, this.signal]));
    } catch (error) {
      if (isAbort(error)) return;
      write(this.state, "");
      this.trouble.replaceChildren(problemNotice(error, () => void this.run()));
    }
  }

  private async ask(picked: Picked, name: string, signal: AbortSignal): Promise<void> {
    const all = picked.scans.length;
    for (const { indices, scans, sighting } of sightings(picked, this.prior(), this.wishes.kind())) {
      write(this.state, `Locating ${this.located.length + 1} of ${counted(all, "scan")}…`);
      const found = await localize(this.id, sighting, signal);
      const news = found.map((one, k): Located => ({
        index: indices[k] as number,
        scan: scans[k] as Located["scan"],
        found: one,
      }));
      this.located.push(...news);
      this.list.append(...news.map((one) => locatedRow(one, (at) => this.wishes.look(at))));
      this.wishes.draw(this.located);
    }
    const placed = this.located.filter(({ found }) => found.pose !== null).length;
    const which = all < picked.of ? `, evenly over the file's ${picked.of}` : "";
    write(this.state, `${name}: ${placed} of ${counted(all, "scan")} located${which}.`);
  }
}

function radio(value: string, title: string, checked: boolean) {
  const input = make("input", { type: "radio", name: "locate", value, checked });
  return { input, element: make("label", { class: "check" }, input, make("span", {}, title)) };
}

function number(id: string, value: number, min: number, step: number | string): HTMLInputElement {
  return make("input", { type: "number", id, value, min, step, inputmode: "decimal" });
}

function button(text: string, onclick: () => void): HTMLElement {
  return make("button", { type: "button", class: "small", onclick }, text);
}
