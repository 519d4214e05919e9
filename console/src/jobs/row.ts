// A job's row in the list.

import { dress, make, write } from "../kit/element";
import { ago, moment } from "../kit/format";
import type { Row } from "../kit/rows";
import { href } from "../route/address";
import type { Abilities } from "../service/abilities";
import type { Job } from "../service/types";
import { Actions, jobName } from "./actions";
import { chip, doing, progressBar, updateChip } from "./status";

export function jobRow(job: Job, abilities: () => Abilities | null, changed: (job: Job) => void): Row<Job> {
  const name = make("a", { class: "name", href: href(["jobs", job.id]) });
  const labels = make("span", { class: "labels" });
  const state = chip(job.status);
  const bar = progressBar();
  const what = make("span", { class: "doing" });
  const why = make("p", { class: "why" });
  const created = make("time", {});
  const actions = new Actions(job, changed);
  const element = make(
    "li",
    { class: "job" },
    make("div", { class: "job-name" }, name, labels),
    make("div", { class: "job-state" }, state, bar.element, what),
    make("div", { class: "job-time" }, created),
    actions.element,
    why,
  );
  const update = (job: Job) => {
    write(name, jobName(job));
    const texts = Object.entries(job.labels).map(([label, value]) => `${label}:${value}`);
    if (labels.textContent !== texts.join("")) labels.replaceChildren(...texts.map(labelLink));
    updateChip(state, job.status);
    bar.update(job);
    write(what, doing(job));
    why.hidden = !job.problem;
    if (job.problem) write(why, `${job.problem.title}: ${job.problem.detail}`);
    dress(created, { datetime: job.created, title: moment(job.created) });
    write(created, ago(job.created));
    actions.update(job, abilities());
  };
  update(job);
  return { element, update };
}

/** A label that filters the list by itself. */
function labelLink(label: string): HTMLElement {
  return make("a", { class: "label", href: href(["jobs"], { label }), title: `Jobs with ${label}` }, label);
}
