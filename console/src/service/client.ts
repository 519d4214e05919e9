// Requests to the service that serves this page.

import { credentials } from "./key";
import { Problem, isAbort } from "./problem";

/** A response that is no error; what is one is thrown as a [`Problem`]. */
export async function request(path: string, init: RequestInit = {}): Promise<Response> {
  let response: Response;
  try {
    response = await fetch(path, {
      ...init,
      headers: { ...credentials(), ...(init.headers as Record<string, string>) },
    });
  } catch (error) {
    if (isAbort(error)) throw error;
    throw Problem.unreachable();
  }
  if (!response.ok) throw await Problem.from(response);
  return response;
}

export async function get<T>(path: string, signal?: AbortSignal | null): Promise<T> {
  const response = await request(path, { signal: signal ?? null, headers: { accept: "application/json" } });
  return response.json();
}

/** Sends JSON with a method, and reads the answer where there is one. */
export async function send<T>(
  method: string,
  path: string,
  body?: unknown,
  headers: Record<string, string> = {},
): Promise<T> {
  const content: RequestInit =
    body === undefined
      ? {}
      : { body: JSON.stringify(body), headers: { "content-type": "application/json", ...headers } };
  const response = await request(path, { headers, ...content, method });
  return response.status === 204 ? (undefined as T) : response.json();
}

/** A path with a query; members that are null or empty are left out. */
export function withQuery(path: string, query: Record<string, string | number | null | undefined>): string {
  const pairs = Object.entries(query).filter(([, value]) => value !== null && value !== undefined && value !== "");
  const text = new URLSearchParams(pairs.map(([name, value]) => [name, String(value)])).toString();
  return text ? `${path}?${text}` : path;
}
