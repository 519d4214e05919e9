// What the map is waiting for or lacks: it is never an empty canvas without a reason and a next step.

import { make, write } from "../kit/element";
import { notice, problemNotice } from "../kit/notice";
import type { Problem } from "../service/problem";
import type { SheetNews } from "./sheet";

/** Why the canvas is empty, and the step that fills it. */
export interface Emptiness {
  title: string;
  detail: string;
  step: string;
  act(): void;
}

export class State implements SheetNews {
  private readonly busy = make("p", { class: "busy", role: "status" });
  private readonly trouble = make("div", { class: "trouble" });
  private readonly blank = make("div", { class: "trouble" });
  readonly element = make("div", { class: "map-state" }, this.busy, this.blank, this.trouble);
  private tiles = 0;
  private what: string | null = null;
  private timer: ReturnType<typeof setTimeout> | undefined;

  constructor(
    private readonly retry: () => void,
    /** Told how many tiles are under way. */
    private readonly counted: (tiles: number) => void,
  ) {}

  loading(count: number): void {
    this.tiles = count;
    this.counted(count);
    this.show();
  }

  fetching(what: string | null): void {
    this.what = what;
    this.show();
  }

  /** Says why nothing is to be seen, and what shows it again; null where something is. */
  empty(why: Emptiness | null): void {
    const shown = this.blank.dataset["why"] ?? "";
    if (shown === (why?.title ?? "")) return;
    this.blank.dataset["why"] = why?.title ?? "";
    if (!why) return this.blank.replaceChildren();
    const step = make("button", { type: "button", onclick: why.act }, why.step);
    this.blank.replaceChildren(notice({ title: why.title, detail: why.detail, steps: [step], role: "status" }));
  }

  /** Shows the first of several alike: twenty tiles fail for one reason. */
  failed(problem: Problem): void {
    if (this.trouble.dataset["detail"] === problem.detail) return;
    this.trouble.dataset["detail"] = problem.detail;
    const again = () => {
      this.trouble.replaceChildren();
      delete this.trouble.dataset["detail"];
      this.retry();
    };
    this.trouble.replaceChildren(problemNotice(problem, again));
  }

  private show(): void {
    clearTimeout(this.timer);
    const text = this.tiles > 0 ? "Loading tiles…" : this.what ? `Loading the ${this.what}…` : "";
    // What takes a moment needs no word.
    this.timer = setTimeout(() => write(this.busy, text), text ? 300 : 0);
  }
}
