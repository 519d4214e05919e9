// What is sent: a job's JSON, or a recording with its options. Either can be tried out first.

import { request } from "../service/client";
import { dryRun, submitJob } from "../service/jobs";
import type { Estimate, Job } from "../service/types";
import type { Form } from "./form";
import type { Reader } from "./reader";

export interface Shipment {
  /** Bytes, before they are packed. */
  size: number;
  /** What it would come to; nothing is kept. */
  tryOut(signal: AbortSignal): Promise<Estimate>;
  /** A repeat with the same key is the same job. */
  send(idempotency: string): Promise<Job>;
}

export async function jobShipment(reader: Reader, form: Form): Promise<Shipment> {
  const body = await reader.body(form.settings());
  return {
    size: body.size,
    tryOut: (signal) => dryRun(body, signal),
    send: (idempotency) => submitJob(body, idempotency),
  };
}

/** A recording goes as it is; the service reads it. */
export function recordingShipment(file: File, form: Form): Shipment {
  const data = new FormData();
  data.append("recording", file);
  const options = { ...form.settings(), ...form.topics() };
  data.append("options", new Blob([JSON.stringify(options)], { type: "application/json" }));
  const post = async (path: string, init: RequestInit) =>
    (await request(path, { method: "POST", body: data, ...init })).json();
  return {
    size: file.size,
    tryOut: (signal) => post("/v1/jobs?dry_run=true", { signal }),
    send: (idempotency) => post("/v1/jobs", { headers: { "idempotency-key": idempotency } }),
  };
}
