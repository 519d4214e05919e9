// Sending: a job's JSON, or a recording with its options.

import { request } from "../service/client";
import { submitJob } from "../service/jobs";
import type { Job } from "../service/types";
import type { Form } from "./form";
import type { Reader } from "./reader";

/** A recording goes as it is; the service reads it. */
export async function sendRecording(file: File, form: Form, idempotency: string): Promise<Job> {
  const data = new FormData();
  data.append("recording", file);
  const options = { ...form.settings(), ...form.topics() };
  data.append("options", new Blob([JSON.stringify(options)], { type: "application/json" }));
  const headers = { "idempotency-key": idempotency };
  return (await request("/v1/jobs", { method: "POST", body: data, headers })).json();
}

export async function sendJob(reader: Reader, form: Form, idempotency: string): Promise<Job> {
  return submitJob(await reader.body(form.settings()), idempotency);
}
