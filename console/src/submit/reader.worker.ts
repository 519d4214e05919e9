// Reads files and writes jobs off the page's thread. The scans stay here; the page gets what it draws, and the body.

import { boundsOf, returnsOf } from "../scan/returns";
import type { Call, Reply, Selection, Settings, Summary } from "./reader";
import { type Content, FileError, readFile } from "../scan/read";

let content: Content | null = null;
let selection: Selection = { every: 1, from: 0, to: null };

self.onmessage = async ({ data }: MessageEvent<Call>) => {
  try {
    if (data.file) {
      content = await readFile(data.file);
      selection = { every: 1, from: 0, to: null };
    }
    if (data.selection) selection = data.selection;
    if (data.settings) return reply({ body: body(data.settings) });
    const summary = summarise();
    reply({ summary }, [summary.returns.points.buffer]);
  } catch (error) {
    const known = error instanceof FileError;
    reply({ error: known ? error.message : `The file could not be read: ${(error as Error).message}` });
  }
};

function reply(message: Reply, transfer: Transferable[] = []): void {
  self.postMessage(message, { transfer });
}

function scans() {
  if (content?.kind === "job") return content.request.scans;
  if (content?.kind !== "log") return [];
  const { every, from, to } = selection;
  return content.scans.slice(from, to ?? undefined).filter((_, k) => k % every === 0);
}

function summarise(): Summary {
  const chosen = scans();
  const poses = chosen.map((scan) => scan.pose);
  const returns = returnsOf(chosen);
  const { scans: _, ...given } = content?.kind === "job" ? content.request : { scans: null };
  return {
    kind: content?.kind ?? "log",
    scans: chosen.length,
    of: content?.kind === "log" ? content.scans.length : chosen.length,
    beams: chosen.reduce((sum, scan) => sum + scan.ranges.length, 0),
    returns,
    poses,
    box: boundsOf(returns, poses),
    given: content?.kind === "job" ? given : null,
  };
}

/** The job as it is sent: what the file says, and over it what the form says. */
function body(settings: Settings): Blob {
  const given = content?.kind === "job" ? content.request : null;
  const job = {
    ...given,
    ...settings,
    map: { ...given?.map, ...settings.map },
    ...(given?.fit || settings.fit ? { fit: { ...given?.fit, ...settings.fit } } : {}),
    scans: scans(),
  };
  return new Blob([JSON.stringify(job)], { type: "application/json" });
}
