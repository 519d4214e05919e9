// What a dropped file is, and its scans. Sizes are checked before anything is read, and again while it is unpacked.

import { bytes } from "../kit/format";
import { LogError, parseCarmen } from "./carmen";
import type { JobRequest, Scan } from "../service/types";

/** What the service takes at most, unpacked. */
export const LARGEST_JOB = 64 * 1024 ** 2;
/** A log says in words what a job says shorter; past this the tab could not hold it. */
export const LARGEST_LOG = 256 * 1024 ** 2;

export type Content =
  | { kind: "job"; request: JobRequest }
  | { kind: "log"; scans: Scan[] }
  /** Read by the service itself. */
  | { kind: "recording"; file: File };

export class FileError extends Error {}

/** `unplaced`: whether scans may have no pose, as those that are to be located. */
export async function readFile(file: File, unplaced = false): Promise<Content> {
  if (file.size === 0) throw new FileError("The file is empty.");
  const json = /\.json(\.gz)?$/i.test(file.name);
  const limit = json ? LARGEST_JOB : LARGEST_LOG;
  if (file.size > limit) throw tooLarge(file.size, limit);
  const head = new Uint8Array(await file.slice(0, 16).arrayBuffer());
  const magic = String.fromCharCode(...head);
  if (magic.startsWith("\u0089MCAP")) {
    if (file.size > LARGEST_JOB) throw tooLarge(file.size, LARGEST_JOB);
    return { kind: "recording", file };
  }
  if (magic.startsWith("#ROSBAG")) {
    throw new FileError(
      "This is a ROS 1 bag. Make a ROS 2 recording of it first: rosbags-convert --src OLD.bag --dst NEW --dst-storage mcap (pip install rosbags)",
    );
  }
  if (magic.startsWith("SQLite")) {
    throw new FileError(
      "This is a ROS 2 bag in SQLite. Make an MCAP recording of it first: rosbags-convert --src FOLDER --dst NEW --dst-storage mcap (pip install rosbags)",
    );
  }
  if (/^P[25]\s/.test(magic) || /\.(pgm|ya?ml)$/i.test(file.name)) {
    throw new FileError("This is a finished occupancy map. mapfit fits laser scans: a picture has no evidence to fit.");
  }
  const text = await textOf(file, head[0] === 0x1f && head[1] === 0x8b, limit);
  return /^\s*\{/.test(text.slice(0, 1000)) ? parseJob(text, unplaced) : { kind: "log", scans: parseLog(text) };
}

function tooLarge(size: number, limit: number): FileError {
  return new FileError(`The file has ${bytes(size)}; ${bytes(limit)} is the limit. Send a part of it, or fewer scans.`);
}

async function textOf(file: File, packed: boolean, limit: number): Promise<string> {
  if (!packed) return file.text();
  const reader = file
    .stream()
    .pipeThrough(new DecompressionStream("gzip"))
    .pipeThrough(new TextDecoderStream())
    .getReader();
  let text = "";
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return text;
      text += value;
      if (text.length > limit) throw tooLarge(text.length, limit);
    }
  } catch (error) {
    await reader.cancel().catch(() => {});
    throw error instanceof FileError ? error : new FileError("The gzip file is damaged or ends too early.");
  }
}

function parseJob(text: string, unplaced: boolean): Content {
  let request: JobRequest;
  try {
    request = JSON.parse(text);
  } catch (error) {
    throw new FileError(`The file is not JSON: ${(error as Error).message}`);
  }
  if (!Array.isArray(request.scans) || request.scans.length === 0) {
    throw new FileError("The file is JSON, but no job: it has no scans. A job is {scans, noise, map}.");
  }
  const placed = (scan: Scan) => typeof scan.pose?.x === "number" || (unplaced && !scan.pose);
  const odd = request.scans.findIndex((scan) => !Array.isArray(scan?.ranges) || !placed(scan));
  if (odd >= 0) throw new FileError(`Scan ${odd} has no ranges or no pose; see the API for what a scan is.`);
  return { kind: "job", request };
}

function parseLog(text: string): Scan[] {
  try {
    return parseCarmen(text);
  } catch (error) {
    if (!(error instanceof LogError)) throw error;
    throw new FileError(
      `${error.message} Files that work: a job as JSON, a CARMEN log with FLASER lines; either may be gzipped.`,
    );
  }
}
