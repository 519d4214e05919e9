// One job: what it does now, why it failed, what it was asked.

import { make, write } from "../kit/element";
import { duration, moment } from "../kit/format";
import { notice, problemNotice } from "../kit/notice";
import { downloadList } from "../kit/downloads";
import { type Address, href } from "../route/address";
import { type Page, heading } from "../route/router";
import { type Abilities, abilities } from "../service/abilities";
import { follow } from "../service/events";
import { getJob, isOpen, jobPath } from "../service/jobs";
import { isAbort } from "../service/problem";
import type { Job } from "../service/types";
import { Actions, jobName } from "./actions";
import { chip, doing, progressBar, took, updateChip } from "./status";

export function jobPage({ path }: Address): Page {
  const id = path[1] ?? "";
  const over = new AbortController();
  const title = heading("Job");
  const element = make(
    "div",
    { class: "page narrow" },
    make("p", { class: "crumb" }, make("a", { href: "#/jobs" }, "Jobs")),
    title,
  );
  const body = make("div", { "aria-busy": "true" }, make("p", {}, "Loading the job…"));
  element.append(body);

  const open = async () => {
    try {
      const [job, able] = await Promise.all([getJob(id, over.signal), abilities().catch(() => null)]);
      const view = new JobView(job, able, title, open);
      body.replaceChildren(view.element);
      if (isOpen(job)) watch(view, job);
    } catch (error) {
      if (!isAbort(error)) body.replaceChildren(problemNotice(error, open));
    }
    body.removeAttribute("aria-busy");
  };
  const watch = (view: JobView, job: Job) => {
    const event = (event: { event: string; data: string }) => {
      const news = JSON.parse(event.data);
      const status = news.stage === "queued" ? job.status : "running";
      job = event.event === "status" ? news : { ...job, status, progress: news };
      view.update(job);
    };
    const following = { event, lost: (lost: boolean) => view.lost(lost), ended: () => void open() };
    void follow(`${jobPath(id)}/events`, following, over.signal);
  };
  void open();
  return { title: "Job", element, leave: () => over.abort() };
}

/** A job's page, updated in place while it runs. */
class JobView {
  readonly element: HTMLElement;
  private readonly chip: HTMLElement;
  private readonly bar = progressBar();
  private readonly doing = make("span", { role: "status" });
  private readonly connection = make("p", { class: "lost", role: "status" });
  private readonly outcome = make("div", {});
  private readonly facts = make("dl", { class: "facts" });
  private readonly actions: Actions;

  constructor(
    job: Job,
    private readonly able: Abilities | null,
    private readonly title: HTMLElement,
    reload: () => void,
  ) {
    this.chip = chip(job.status);
    this.actions = new Actions(job, reload);
    const request = {
      path: `${jobPath(job.id)}/request`,
      file: `${job.id}.json`,
      title: "The request, whole",
      format: "JSON",
    };
    this.element = make(
      "div",
      {},
      make("div", { class: "job-state" }, this.chip, this.bar.element, this.doing),
      this.connection,
      this.outcome,
      this.actions.element,
      this.facts,
      make("h2", {}, "What was asked"),
      downloadList([request]),
    );
    this.update(job);
  }

  update(job: Job): void {
    const name = jobName(job);
    write(this.title, name);
    document.title = `${name} · mapfit`;
    updateChip(this.chip, job.status);
    this.bar.update(job);
    write(this.doing, doing(job));
    this.outcome.replaceChildren(...outcome(job));
    this.actions.update(job, this.able);
    const seconds = took(job);
    const facts: [string, string | HTMLElement | null][] = [
      ["Id", make("code", {}, job.id)],
      ["Submitted", moment(job.created)],
      ["Started", moment(job.started) || null],
      ["Took", seconds === null ? null : duration(seconds)],
      ["Attempts", job.attempt > 1 ? String(job.attempt) : null],
      ["Priority", job.priority ? String(job.priority) : null],
      [
        "Labels",
        Object.entries(job.labels)
          .map(([label, value]) => `${label}:${value}`)
          .join(", ") || null,
      ],
      ["Retry of", job.retry_of ? make("a", { href: href(["jobs", job.retry_of]) }, job.retry_of) : null],
    ];
    const shown = facts.filter(([, fact]) => fact !== null);
    this.facts.replaceChildren(
      ...shown.map(([name, fact]) => make("div", {}, make("dt", {}, name), make("dd", {}, fact))),
    );
  }

  lost(lost: boolean): void {
    write(this.connection, lost ? "The connection is lost; trying again. The job goes on." : "");
  }
}

/** What became of it, where something did. */
function outcome(job: Job): HTMLElement[] {
  if (job.problem) return [notice({ title: job.problem.title, detail: job.problem.detail, role: "alert" })];
  if (job.status === "dismissed")
    return [notice({ title: "Cancelled", detail: "It made no map. Its request is kept below." })];
  if (job.message) return [notice({ title: "Note", detail: job.message })];
  return [];
}
