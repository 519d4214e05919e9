// A page of jobs that stays true: the list is asked every few seconds, and running jobs are followed by their events.

import { follow } from "../service/events";
import { type JobFilter, isOpen, jobPath, listJobs } from "../service/jobs";
import { Problem, isAbort } from "../service/problem";
import type { Job, Page } from "../service/types";

const PERIOD = 3000;
/** Browsers open six connections to a service that speaks HTTP/1.1: half of them stay free for everything else. */
const FOLLOWED = 3;

export interface Watching {
  page(page: Page<Job>): void;
  job(job: Job): void;
  /** Null when all is well again. */
  trouble(problem: Problem | null): void;
}

export class LiveJobs {
  private readonly over = new AbortController();
  private asking: AbortController | null = null;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private jobs = new Map<string, Job>();
  private readonly followed = new Map<string, AbortController>();

  constructor(
    private filter: JobFilter,
    private readonly watching: Watching,
  ) {
    document.addEventListener("visibilitychange", () => document.hidden || this.refresh(), {
      signal: this.over.signal,
    });
    void this.refresh();
  }

  show(filter: JobFilter): void {
    this.filter = filter;
    void this.refresh();
  }

  stop(): void {
    this.over.abort();
    this.asking?.abort();
    clearTimeout(this.timer);
  }

  async refresh(): Promise<void> {
    clearTimeout(this.timer);
    this.asking?.abort();
    const asking = new AbortController();
    this.asking = asking;
    try {
      const page = await listJobs(this.filter, asking.signal);
      this.watching.trouble(null);
      this.jobs = new Map(page.items.map((job) => [job.id, job]));
      this.watching.page(page);
      this.followRunning();
    } catch (error) {
      if (isAbort(error)) return;
      this.watching.trouble(Problem.of(error));
    }
    // A page nobody sees asks for nothing; it is refreshed when it is seen again.
    if (!this.over.signal.aborted && !document.hidden) this.timer = setTimeout(() => void this.refresh(), PERIOD);
  }

  private followRunning(): void {
    const open = [...this.jobs.values()].filter(isOpen);
    const wanted = open
      .sort((a, b) => Number(b.status === "running") - Number(a.status === "running"))
      .slice(0, FOLLOWED);
    const ids = new Set(wanted.map((job) => job.id));
    for (const [id, stop] of this.followed) {
      if (!ids.has(id)) stop.abort();
    }
    for (const job of wanted) this.follow(job.id);
  }

  private follow(id: string): void {
    if (this.followed.has(id)) return;
    const stop = new AbortController();
    this.followed.set(id, stop);
    const event = (event: { event: string; data: string }) => {
      const job = this.jobs.get(id);
      if (!job) return;
      const body = JSON.parse(event.data);
      const newer: Job = event.event === "status" ? body : { ...job, status: "running", progress: body };
      if (event.event !== "status" && body.stage === "queued") newer.status = job.status;
      this.jobs.set(id, newer);
      this.watching.job(newer);
      if (event.event === "status") void this.refresh();
    };
    const following = { event, lost: () => {}, ended: () => {} };
    const signal = AbortSignal.any([this.over.signal, stop.signal]);
    void follow(`${jobPath(id)}/events`, following, signal).finally(() => this.followed.delete(id));
  }
}
