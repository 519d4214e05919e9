// The service as the tests speak to it, past the console.

/** Sends JSON; what is refused is an error with the service's words. */
export async function ask<T>(service: string, method: string, path: string, body?: object): Promise<T> {
  const headers = { "content-type": "application/json" };
  const response = await fetch(service + path, { method, ...(body ? { body: JSON.stringify(body), headers } : {}) });
  const text = await response.text();
  if (!response.ok) throw new Error(`${method} ${path}: ${response.status} ${text}`);
  return (text ? JSON.parse(text) : null) as T;
}

/** A job's map, once it is there. */
export async function finished(service: string, job: string): Promise<string> {
  for (;;) {
    const { map_id, status, problem } = await ask<{ map_id: string | null; status: string; problem: unknown }>(
      service,
      "GET",
      `/v1/jobs/${job}?wait=60`,
    );
    if (map_id) return map_id;
    if (status !== "accepted" && status !== "running")
      throw new Error(`job ${job} made no map: ${JSON.stringify(problem)}`);
  }
}
