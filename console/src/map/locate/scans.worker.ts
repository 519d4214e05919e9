// Reads a file off the page's thread and gives back the scans that were wanted of it.

import { FileError, readFile } from "../../scan/read";
import { type Found, type Wanted, spread } from "./scans";

self.onmessage = async ({ data }: MessageEvent<Wanted>) => {
  const answer = (found: Found) => self.postMessage(found);
  try {
    const content = await readFile(data.file, true);
    if (content.kind === "recording")
      throw new FileError(
        "Recordings are located from a terminal: mapfit localize MAP FILE.mcap. Here a job as JSON or a CARMEN log works.",
      );
    const all = content.kind === "job" ? content.request.scans : content.scans;
    const indices = spread(all.length, data.most);
    const noise = content.kind === "job" ? (content.request.noise ?? null) : null;
    answer({ picked: { indices, scans: indices.map((k) => all[k] as never), of: all.length, noise } });
  } catch (error) {
    const known = error instanceof FileError;
    answer({ error: known ? error.message : `The file could not be read: ${(error as Error).message}` });
  }
};
