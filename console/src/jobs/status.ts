// A job's state in words, colour and a bar.

import { make, write } from "../kit/element";
import { duration } from "../kit/format";
import type { Job, Status } from "../service/types";

const WORDS: Record<Status, string> = {
  accepted: "waiting",
  running: "running",
  successful: "done",
  failed: "failed",
  dismissed: "cancelled",
};

export function statusWord(status: string): string {
  return WORDS[status as Status] ?? status;
}

/** A chip that says the state; the word says it too, for those who see no colour. */
export function chip(status: Status): HTMLElement {
  return make("span", { class: `chip ${status}` }, statusWord(status));
}

export function updateChip(chip: HTMLElement, status: Status): void {
  chip.className = `chip ${status}`;
  write(chip, statusWord(status));
}

/** What a job is doing, or what became of it, in one line. */
export function doing(job: Job): string {
  const { stage, iteration } = job.progress;
  if (job.status === "running") {
    const parts = job.parts ? `, part ${job.parts.done} of ${job.parts.total}` : "";
    const step = stage === "fitting" && iteration > 0 ? `, step ${iteration}` : "";
    return `${stage}${step}${parts}`;
  }
  if (job.status === "accepted") return "waiting for a worker";
  const seconds = took(job);
  return seconds === null ? "" : `${job.status === "successful" ? "took" : "after"} ${duration(seconds)}`;
}

export function took(job: Job): number | null {
  if (!job.started || !job.finished) return null;
  return (Date.parse(job.finished) - Date.parse(job.started)) / 1000;
}

/** A progress bar that is updated in place. */
export function progressBar(): { element: HTMLProgressElement; update(job: Job): void } {
  const element = make("progress", { max: 100, "aria-label": "Progress" });
  const update = (job: Job) => {
    element.hidden = job.status !== "running" && job.status !== "accepted";
    element.value = job.progress.percent;
    element.setAttribute("aria-valuetext", `${Math.round(job.progress.percent)} %, ${doing(job)}`);
  };
  return { element, update };
}
