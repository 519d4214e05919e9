// What can be done with a job, from its row or its page.

import { make } from "../kit/element";
import { ask } from "../kit/dialog";
import { say } from "../kit/notice";
import { href } from "../route/address";
import type { Abilities } from "../service/abilities";
import { cancelJob, isOpen, retryJob } from "../service/jobs";
import { Problem } from "../service/problem";
import type { Job } from "../service/types";

export function jobName(job: { name: string | null; id: string }): string {
  return job.name || `unnamed ${job.id.slice(-6)}`;
}

/** Buttons of a job's state; the element stays, and a button is replaced only where what it does changed. */
export class Actions {
  readonly element = make("div", { class: "actions" });
  private shown = "";

  constructor(
    private job: Job,
    private readonly changed: (job: Job) => void,
  ) {}

  update(job: Job, abilities: Abilities | null): void {
    this.job = job;
    const map = job.status === "successful" && job.map_id;
    const retry = !isOpen(job) && job.status !== "successful" && abilities?.has("post", "/v1/jobs/{id}/retry");
    const what = map ? "map" : isOpen(job) ? "cancel" : retry ? "retry" : "";
    if (what === this.shown) return;
    this.shown = what;
    const focused = this.element.contains(document.activeElement);
    const name = jobName(job);
    const button = {
      map: () =>
        make(
          "a",
          { class: "button primary", href: href(["maps", job.map_id ?? ""]), "aria-label": `Open map: ${name}` },
          "Open map",
        ),
      cancel: () =>
        make("button", { type: "button", onclick: () => void this.cancel(), "aria-label": `Cancel ${name}` }, "Cancel"),
      retry: () =>
        make("button", { type: "button", onclick: () => void this.retry(), "aria-label": `Retry ${name}` }, "Retry"),
      "": () => null,
    }[what]();
    this.element.replaceChildren(...(button ? [button] : []));
    // A job that ended under someone's hands leaves them where they were.
    if (focused) button?.focus();
  }

  private async cancel(): Promise<void> {
    const sure = await ask({
      title: `Cancel ${jobName(this.job)}?`,
      detail: "It stops within one step and makes no map. Its request is kept.",
      yes: "Cancel the job",
      no: "Keep it",
    });
    if (sure) await this.attempt(async () => [await cancelJob(this.job.id), "Cancelled"]);
  }

  private async retry(): Promise<void> {
    await this.attempt(async () => {
      const job = await retryJob(this.job.id);
      location.hash = href(["jobs", job.id]);
      return [job, "Sent again as a new job"];
    });
  }

  private async attempt(act: () => Promise<[Job, string]>): Promise<void> {
    try {
      const [job, done] = await act();
      say(`${done}: ${jobName(job)}`);
      this.changed(job);
    } catch (error) {
      const problem = Problem.of(error);
      say(`${problem.title}. ${problem.detail}`);
    }
  }
}
