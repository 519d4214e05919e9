// What a map was made of, fetched when it is first shown: poses, and returns at them.

import { credentials } from "../service/key";
import { getPoses } from "../service/maps";
import { Problem } from "../service/problem";
import type { FittedPoses, MapRecord } from "../service/types";
import type { Returns } from "../scan/returns";
import type { Found, Wanted } from "./returns.worker";

export class MapData {
  private fetchedPoses: Promise<FittedPoses> | null = null;
  private fetchedReturns: Promise<{ returns: Returns; fitted: boolean }> | null = null;

  constructor(
    private readonly record: MapRecord,
    private readonly signal: AbortSignal,
  ) {}

  poses(): Promise<FittedPoses> {
    this.fetchedPoses ??= getPoses(this.record.id, this.signal);
    this.fetchedPoses.catch(() => (this.fetchedPoses = null));
    return this.fetchedPoses;
  }

  /** The returns, where the fit has their poses; where the request says, if the fit has others' too. */
  returns(): Promise<{ returns: Returns; fitted: boolean }> {
    this.fetchedReturns ??= this.fetchReturns();
    this.fetchedReturns.catch(() => (this.fetchedReturns = null));
    return this.fetchedReturns;
  }

  private async fetchReturns(): Promise<{ returns: Returns; fitted: boolean }> {
    const poses = await this.poses().then(
      ({ poses }) => poses.map(({ pose }) => pose),
      () => [],
    );
    const worker = new Worker(new URL("./returns.worker.ts", import.meta.url), { type: "module" });
    const stop = () => worker.terminate();
    this.signal.addEventListener("abort", stop, { once: true });
    try {
      const found = await new Promise<Found>((resolve, reject) => {
        worker.onmessage = ({ data }: MessageEvent<Found>) => resolve(data);
        worker.onerror = () =>
          reject(new Problem(-1, "The returns cannot be read", "The browser could not start a worker."));
        const { job_id: job, parent = null } = this.record;
        const service = location.origin;
        worker.postMessage({ service, headers: credentials(), job, parent, poses } satisfies Wanted);
      });
      if (found.returns) return { returns: found.returns, fitted: found.fitted ?? false };
      if (found.entangled) {
        const detail = "The maps it was joined of share scans: open one of them for its returns.";
        throw new Problem(-1, "No returns to draw", detail);
      }
      if (found.status === 404) throw new Problem(404, "No returns to draw", "The request of this map's job is gone.");
      throw found.status
        ? new Problem(found.status, "The returns were not answered", `Answer ${found.status}.`)
        : Problem.unreachable();
    } finally {
      stop();
      this.signal.removeEventListener("abort", stop);
    }
  }
}
