// The line that says what a job will come to, kept up while the form changes.

import { make, write } from "../kit/element";
import { bytes } from "../kit/format";
import type { Abilities } from "../service/abilities";
import { Problem, isAbort } from "../service/problem";
import type { Estimate, Lattice } from "../service/types";
import { latticeOf, sentence } from "./estimate";
import { LARGEST_JOB } from "../scan/read";
import type { Settings, Summary } from "./reader";
import type { Shipment } from "./send";

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
    private readonly pack: () => Promise<Shipment>,
    private readonly able: Abilities | null,
    private readonly signal: AbortSignal,
    private readonly told: { lattice(lattice: Lattice | null): void; estimate(estimate: Estimate): void },
  ) {}

  ask(summary: Summary, settings: Settings): void {
    clearTimeout(this.timer);
    this.asking.abort();
    const lattice = latticeOf(summary, settings);
    this.told.lattice(lattice);
    write(this.line, sentence(lattice, null));
    this.button.hidden = true;
    this.timer = setTimeout(() => void this.consider(), PAUSE);
  }

  private async consider(): Promise<void> {
    const shipment = await this.pack().catch(() => null);
    if (!shipment) return;
    if (shipment.size > LARGEST_JOB) {
      write(this.line, `The job has ${bytes(shipment.size)}; ${bytes(LARGEST_JOB)} is the limit. Take fewer scans.`);
      return;
    }
    // A service that knows no dry run would run the job.
    if (!this.able?.takes("post", "/v1/jobs", "dry_run")) return;
    this.act = () => this.tryOut(shipment);
    if (shipment.size <= TRIED_UNASKED) await this.act();
    else this.button.hidden = false;
  }

  private async tryOut(shipment: Shipment): Promise<void> {
    this.button.hidden = true;
    this.asking = new AbortController();
    try {
      const estimate = await shipment.tryOut(AbortSignal.any([this.asking.signal, this.signal]));
      this.told.lattice(estimate.lattice);
      this.told.estimate(estimate);
      write(this.line, sentence(estimate.lattice, estimate));
    } catch (error) {
      if (isAbort(error)) return;
      const { detail, errors } = Problem.of(error);
      write(this.line, `As it is the service would refuse it: ${errors[0]?.detail ?? detail}`);
    }
  }
}
