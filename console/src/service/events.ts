// Server-sent events through `fetch`: `EventSource` cannot send a key.

import { request } from "./client";
import { Problem, isAbort } from "./problem";

export interface ServerEvent {
  event: string;
  id: string;
  data: string;
}

/** The events of a stream's text, which comes in pieces of any size. */
export class EventParser {
  private rest = "";

  push(text: string): ServerEvent[] {
    // A piece may end within a line's end, between its CR and its LF.
    const blocks = (this.rest + text).replace(/\r\n/g, "\n").split("\n\n");
    this.rest = blocks.pop() ?? "";
    return blocks.map(parse).filter((event): event is ServerEvent => event !== null);
  }
}

function parse(block: string): ServerEvent | null {
  const event: ServerEvent = { event: "message", id: "", data: "" };
  const data: string[] = [];
  for (const line of block.split("\n")) {
    const [name = "", value = ""] = line.split(/: ?(.*)/s);
    if (name === "data") data.push(value);
    else if (name === "event" || name === "id") event[name] = value;
  }
  event.data = data.join("\n");
  // Comments keep the connection alive, and say nothing.
  return data.length > 0 ? event : null;
}

export interface Following {
  event(event: ServerEvent): void;
  /** The connection is lost, and tried again; or it is back. */
  lost(lost: boolean): void;
  /** It ended for good: the job has ended, or the service refused. */
  ended(problem: Problem | null): void;
}

const FIRST_PAUSE = 500;
const LONGEST_PAUSE = 15_000;
/** Without even a comment for this long, a connection is dead: the service writes one every ten seconds. */
const SILENCE = 30_000;

/** Follows a stream to its end, over as many connections as it takes; `Last-Event-ID` resumes behind what was seen. */
export async function follow(path: string, following: Following, signal: AbortSignal): Promise<void> {
  let last = "";
  let pause = FIRST_PAUSE;
  while (!signal.aborted) {
    try {
      const over = await read(path, last, signal, (event) => {
        if (event) last = event.id || last;
        pause = FIRST_PAUSE;
        following.lost(false);
        if (event) following.event(event);
        return event?.event === "status";
      });
      if (over) return following.ended(null);
    } catch (error) {
      if (signal.aborted) return;
      const problem = Problem.of(error);
      // Refused, and not for a while only: 401, 403, 404.
      if (!isAbort(error) && problem.status >= 400 && problem.status < 500 && problem.status !== 429)
        return following.ended(problem);
    }
    following.lost(true);
    await new Promise((resolve) => setTimeout(resolve, pause));
    pause = Math.min(2 * pause, LONGEST_PAUSE);
  }
}

/** One connection; true when the stream is over for good. */
async function read(
  path: string,
  last: string,
  signal: AbortSignal,
  heard: (event: ServerEvent | null) => boolean,
): Promise<boolean> {
  const silence = new AbortController();
  const connection = AbortSignal.any([signal, silence.signal]);
  const headers: Record<string, string> = { accept: "text/event-stream", ...(last ? { "last-event-id": last } : {}) };
  let watch = setTimeout(() => silence.abort(), SILENCE);
  try {
    const response = await request(path, { headers, signal: connection, cache: "no-store" });
    if (response.status === 204 || !response.body) return true;
    const parser = new EventParser();
    const decoder = new TextDecoder();
    const reader = response.body.getReader();
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return false;
      clearTimeout(watch);
      watch = setTimeout(() => silence.abort(), SILENCE);
      const events = parser.push(decoder.decode(value, { stream: true }));
      if (events.length === 0) heard(null);
      if (events.map(heard).some(Boolean)) return true;
    }
  } finally {
    clearTimeout(watch);
  }
}
