// RFC 9457 problems, as the service answers them, and what else can go wrong in their shape.

export interface Fault {
  pointer?: string | null;
  parameter?: string | null;
  detail: string;
}

export class Problem extends Error {
  constructor(
    readonly status: number,
    readonly title: string,
    readonly detail: string,
    readonly errors: Fault[] = [],
    /** The last part of its type: `invalid-request`. */
    readonly slug = "",
  ) {
    super(detail || title);
  }

  static async from(response: Response): Promise<Problem> {
    const body = await response.json().catch(() => ({}));
    const slug = String(body.type ?? "")
      .split("/")
      .pop();
    const wait = response.status === 429 ? response.headers.get("retry-after") : null;
    const detail = [body.detail ?? "", wait ? `Try again in ${wait} s.` : ""].filter(Boolean).join(" ");
    return new Problem(response.status, body.title ?? `Answer ${response.status}`, detail, body.errors ?? [], slug);
  }

  /** The service was not reached at all. */
  static unreachable(): Problem {
    const detail = "Nothing answers at this address. The service may be restarting, or the network may be gone.";
    return new Problem(0, "The service does not answer", detail);
  }

  static of(error: unknown): Problem {
    if (error instanceof Problem) return error;
    return new Problem(-1, "Something went wrong here", error instanceof Error ? error.message : String(error));
  }
}

export function isAbort(error: unknown): boolean {
  return error instanceof DOMException && error.name === "AbortError";
}
