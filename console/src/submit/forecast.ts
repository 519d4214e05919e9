// The line that says what a job will come to, kept up while the form changes.

import { make, write } from "../kit/element";
import { bytes } from "../kit/format";
import type { Abilities } from "../service/abilities";
import { dryRun } from "../service/jobs";
import { Problem, isAbort } from "../service/problem";
import type { Lattice } from "../service/types";
import { latticeOf, sentence } from "./estimate";
import { LARGEST_JOB } from "./read";
import type { Reader, Settings, Summary } from "./reader";

/** Larger jobs are tried only when someone asks: a trial sends the whole of them. */
const TRIED_UNASKED = 12 * 1024 ** 2;
const PAUSE = 400;

export class Forecast {
  private readonly line = make("p", { role: "status" });
  private readonly button = make(
    "button",
    { type: "button", class: "small", hidden: true, onclick: () => void this.act?.() },
    "Ask the service what it will take",
  );
  readonly element = make("div", { class: "forecast" }, this.line, this.button);
  private timer: ReturnType<typeof setTimeout> | undefined;
  private asking = new AbortController();
  private act: (() => Promise<void>) | null = null;

  constructor(
    private readonly reader: Reader,
    private readonly able: Abilities | null,
    private readonly signal: AbortSignal,
    private readonly lattice: (lattice: Lattice | null) => void,
  ) {}

  ask(summary: Summary, settings: Settings): void {
    clearTimeout(this.timer);
    this.asking.abort();
    const lattice = latticeOf(summary, settings);
    this.lattice(lattice);
    write(this.line, sentence(lattice, null));
    this.button.hidden = true;
    this.timer = setTimeout(() => void this.consider(settings), PAUSE);
  }

  private async consider(settings: Settings): Promise<void> {
    const body = await this.reader.body(settings).catch(() => null);
    if (!body) return;
    if (body.size > LARGEST_JOB) {
      write(this.line, `The job has ${bytes(body.size)}; ${bytes(LARGEST_JOB)} is the limit. Take fewer scans.`);
      return;
    }
    // A service that knows no dry run would run the job.
    if (!this.able?.takes("post", "/v1/jobs", "dry_run")) return;
    this.act = () => this.tryOut(body);
    if (body.size <= TRIED_UNASKED) await this.act();
    else this.button.hidden = false;
  }

  private async tryOut(body: Blob): Promise<void> {
    this.button.hidden = true;
    this.asking = new AbortController();
    try {
      const estimate = await dryRun(body, AbortSignal.any([this.asking.signal, this.signal]));
      this.lattice(estimate.lattice);
      write(this.line, sentence(estimate.lattice, estimate));
    } catch (error) {
      if (isAbort(error)) return;
      const { detail, errors } = Problem.of(error);
      write(this.line, `As it is the service would refuse it: ${errors[0]?.detail ?? detail}`);
    }
  }
}
