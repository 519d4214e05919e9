// The scans of a dropped file that are to be located: read off the page's thread, some of them, evenly over the file.

import type { Noise, Scan } from "../../service/types";

export type FreeScan = Omit<Scan, "pose"> & { pose: Scan["pose"] | null };

export interface Picked {
  /** Which of the file's scans these are, counted from 0. */
  indices: number[];
  scans: FreeScan[];
  /** How many the file has. */
  of: number;
  /** What a job file says of its noise. */
  noise: Noise | null;
}

export interface Wanted {
  file: File;
  most: number;
}
export interface Found {
  picked?: Picked;
  error?: string;
}

export function pickScans(file: File, most: number, signal: AbortSignal): Promise<Picked> {
  const worker = new Worker(new URL("./scans.worker.ts", import.meta.url), { type: "module" });
  const picked = new Promise<Picked>((resolve, reject) => {
    signal.addEventListener("abort", () => reject(signal.reason), { once: true });
    worker.onmessage = ({ data }: MessageEvent<Found>) =>
      data.picked ? resolve(data.picked) : reject(new Error(data.error));
    worker.onerror = (event) => reject(new Error(event.message || "The file's reader could not be started."));
    worker.postMessage({ file, most } satisfies Wanted);
  });
  return picked.finally(() => worker.terminate());
}

/** At most so many of `of` indices, the first among them, evenly spaced. */
export function spread(of: number, most: number): number[] {
  const count = Math.min(of, Math.max(1, Math.floor(most)));
  return Array.from({ length: count }, (_, k) => Math.floor((k * of) / count));
}
