// What this service can do, read from its own document: the console serves older and newer ones, and offers no button
// that would answer 404. `POST /v1/jobs?dry_run=true` above all: a service that knows no dry run would run the job.

import { get } from "./client";

interface Operation {
  parameters?: { name: string }[];
  requestBody?: { content?: Record<string, unknown> };
}
interface Document {
  info?: { version?: string };
  paths: Record<string, Record<string, Operation>>;
}

export interface Abilities {
  version: string;
  has(method: string, path: string): boolean;
  takes(method: string, path: string, parameter: string): boolean;
  reads(method: string, path: string, media: string): boolean;
}

let known: Promise<Abilities> | null = null;

export function abilities(): Promise<Abilities> {
  known ??= get<Document>("/openapi.json").then(of);
  // What failed is asked again the next time.
  known.catch(() => (known = null));
  return known;
}

export function of(document: Document): Abilities {
  const operation = (method: string, path: string) => document.paths[path]?.[method];
  return {
    version: document.info?.version ?? "",
    has: (method, path) => operation(method, path) !== undefined,
    takes: (method, path, name) => operation(method, path)?.parameters?.some((one) => one.name === name) ?? false,
    reads: (method, path, media) => operation(method, path)?.requestBody?.content?.[media] !== undefined,
  };
}
