// The page's side of the worker that reads files.

import type { Returns } from "../scan/returns";
import type { Distance, JobRequest, Noise, Pose } from "../service/types";

/** Which scans of a log are taken. */
export interface Selection {
  every: number;
  from: number;
  /** One past the last; to the end where null. */
  to: number | null;
}

/** What the form says of a job. */
export interface Settings {
  name: string | null;
  labels?: Record<string, string>;
  noise: Noise;
  map: { distance: Distance; resolution: number };
  fit?: Record<string, unknown>;
  priority?: number;
}

export interface Summary {
  kind: "job" | "log" | "recording";
  scans: number;
  /** How many the file has. */
  of: number;
  beams: number;
  returns: Returns;
  poses: Pose[];
  box: [number, number, number, number] | null;
  /** What a job file says beside its scans. */
  given: Partial<Omit<JobRequest, "scans">> | null;
}

export interface Call {
  file?: File;
  selection?: Selection;
  settings?: Settings;
}
export interface Reply {
  summary?: Summary;
  body?: Blob;
  error?: string;
}

/** One question at a time, in order. */
export class Reader {
  private readonly worker = new Worker(new URL("./reader.worker.ts", import.meta.url), { type: "module" });
  private last: Promise<unknown> = Promise.resolve();

  read(file: File): Promise<Summary> {
    return this.call({ file }).then((reply) => reply.summary as Summary);
  }

  select(selection: Selection): Promise<Summary> {
    return this.call({ selection }).then((reply) => reply.summary as Summary);
  }

  body(settings: Settings): Promise<Blob> {
    return this.call({ settings }).then((reply) => reply.body as Blob);
  }

  dispose(): void {
    this.worker.terminate();
  }

  private call(call: Call): Promise<Reply> {
    const answer = this.last.then(
      () =>
        new Promise<Reply>((resolve, reject) => {
          this.worker.onmessage = ({ data }: MessageEvent<Reply>) =>
            data.error ? reject(new Error(data.error)) : resolve(data);
          this.worker.onerror = (event) =>
            reject(new Error(event.message || "The file's reader could not be started."));
          this.worker.postMessage(call);
        }),
    );
    this.last = answer.catch(() => {});
    return answer;
  }
}
