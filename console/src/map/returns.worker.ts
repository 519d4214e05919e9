// Fetches what a map was made of and works out its returns, off the page's thread: a request can have 64 MiB. An update's scans
// follow those of the map it grew from; a join has those of its maps, in their order.

import { type Returns, returnsOf } from "../scan/returns";
import type { JobRequest, Pose, Scan } from "../service/types";

export interface Wanted {
  /** The service's address. */
  service: string;
  headers: Record<string, string>;
  job: string;
  parent: string | null;
  poses: Pose[];
}
export interface Found {
  returns?: Returns;
  /** Whether the fitted poses were the request's scans', so that returns lie where the fit has them. */
  fitted?: boolean;
  /** The answer that was an error; 0 where there was none. */
  status?: number;
  /** Its maps share scans, or were joined themselves: nobody here can tell which pose is whose. */
  entangled?: boolean;
}

class Refused extends Error {
  constructor(readonly status: number) {
    super();
  }
}

self.onmessage = async ({ data }: MessageEvent<Wanted>) => {
  const answer = (found: Found, transfer: Transferable[] = []) => self.postMessage(found, { transfer });
  try {
    const { scans, joined } = await new Origins(data).scansOf(data.job, data.parent);
    const fitted = data.poses.length === scans.length;
    // Only fitted poses are all in one frame.
    if (joined && !fitted) return answer({ entangled: true });
    const returns = returnsOf(scans, fitted ? data.poses : undefined);
    answer({ returns, fitted }, [returns.points.buffer]);
  } catch (error) {
    answer({ status: error instanceof Refused ? error.status : 0 });
  }
};

class Origins {
  constructor(private readonly wanted: Wanted) {}

  async scansOf(job: string, parent: string | null): Promise<{ scans: Scan[]; joined: boolean }> {
    const request = await this.get<Partial<JobRequest> & { maps?: { id: string }[] }>(`/v1/jobs/${job}/request`);
    const before = request.maps ? [...new Set(request.maps.map(({ id }) => id))] : parent ? [parent] : [];
    const all: Scan[] = [];
    let joined = request.maps !== undefined;
    for (const id of before) {
      const map = await this.get<{ job_id: string; parent?: string | null }>(`/v1/maps/${id}`);
      const theirs = await this.scansOf(map.job_id, map.parent ?? null);
      joined ||= theirs.joined;
      for (const scan of theirs.scans) all.push(scan);
    }
    for (const scan of request.scans ?? []) all.push(scan);
    return { scans: all, joined };
  }

  private async get<T>(path: string): Promise<T> {
    const response = await fetch(this.wanted.service + path, { headers: this.wanted.headers });
    if (!response.ok) throw new Refused(response.status);
    return response.json();
  }
}
