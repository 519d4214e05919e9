// Fetches a job's request and works out its returns, off the page's thread: a request can have 64 MiB.

import { type Returns, returnsOf } from "../scan/returns";
import type { JobRequest, Pose } from "../service/types";

export interface Wanted {
  url: string;
  headers: Record<string, string>;
  poses: Pose[];
}
export interface Found {
  returns?: Returns;
  /** Whether the fitted poses were the request's scans', so that returns lie where the fit has them. */
  fitted?: boolean;
  status?: number;
}

self.onmessage = async ({ data }: MessageEvent<Wanted>) => {
  const answer = (found: Found, transfer: Transferable[] = []) => self.postMessage(found, { transfer });
  try {
    const response = await fetch(data.url, { headers: data.headers });
    if (!response.ok) return answer({ status: response.status });
    const { scans }: JobRequest = await response.json();
    const fitted = data.poses.length === scans.length;
    const returns = returnsOf(scans, fitted ? data.poses : undefined);
    answer({ returns, fitted }, [returns.points.buffer]);
  } catch {
    answer({ status: 0 });
  }
};
