// Jobs, as the service knows them.

import { get, request, send, withQuery } from "./client";
import type { Estimate, Job, Page } from "./types";

export interface JobFilter {
  status?: string | null;
  label?: string | null;
  cursor?: string | null;
}

/** Rows of a page: more than a screen shows, few enough to be drawn in a moment, however many jobs there are. */
const PAGE = 50;

/** Whether a job has not ended. */
export function isOpen(job: Job): boolean {
  return job.status === "accepted" || job.status === "running";
}

export function listJobs(filter: JobFilter, signal: AbortSignal): Promise<Page<Job>> {
  return get(withQuery("/v1/jobs", { ...filter, limit: PAGE }), signal);
}

export function getJob(id: string, signal?: AbortSignal): Promise<Job> {
  return get(jobPath(id), signal);
}

export function cancelJob(id: string): Promise<Job> {
  return send("DELETE", jobPath(id));
}

/** A new job of an ended one's request. */
export function retryJob(id: string): Promise<Job> {
  return send("POST", `${jobPath(id)}/retry`);
}

/** Sends a job's body. The key makes a repeat after a lost connection the same job. */
export async function submitJob(body: Blob, idempotency: string): Promise<Job> {
  const packed = await gzip(body);
  const headers = { "content-type": "application/json", "content-encoding": "gzip", "idempotency-key": idempotency };
  return (await request("/v1/jobs", { method: "POST", body: packed, headers })).json();
}

/** What a job's body would come to: its lattice, its returns, its cost. Nothing is kept. */
export async function dryRun(body: Blob, signal: AbortSignal): Promise<Estimate> {
  const headers = { "content-type": "application/json", "content-encoding": "gzip" };
  const init = { method: "POST", body: await gzip(body), headers, signal };
  return (await request("/v1/jobs?dry_run=true", init)).json();
}

export function jobPath(id: string): string {
  return `/v1/jobs/${encodeURIComponent(id)}`;
}

/** Ranges are digits: a fifth of them is sent. */
function gzip(body: Blob): Promise<Blob> {
  return new Response(body.stream().pipeThrough(new CompressionStream("gzip"))).blob();
}
