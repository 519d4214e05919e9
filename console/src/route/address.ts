// Addresses are behind the `#`: the service serves one page, and every state of it can be linked and gone back to.

export interface Address {
  /** `#/maps/ID` is `["maps", "ID"]`. */
  path: string[];
  query: URLSearchParams;
}

export type Query = Record<string, string | null | undefined>;

export function parse(hash: string): Address {
  const [path = "", query = ""] = hash.replace(/^#\/?/, "").split(/\?(.*)/s);
  return { path: path.split("/").filter(Boolean).map(decode), query: new URLSearchParams(query) };
}

/** An address to link to; members of the query that are null or empty are left out. */
export function href(path: string[], query: Query = {}): string {
  const pairs = Object.entries(query).filter((pair): pair is [string, string] => Boolean(pair[1]));
  // Colons and commas are data of ours and may stand as they are in a fragment: addresses stay readable.
  const text = pairs.map(
    ([name, value]) => `${name}=${encodeURIComponent(value).replace(/%2C/g, ",").replace(/%3A/g, ":")}`,
  );
  return `#/${path.map(encodeURIComponent).join("/")}${text.length > 0 ? `?${text.join("&")}` : ""}`;
}

/** A broken escape is taken as it stands rather than as an error. */
function decode(part: string): string {
  try {
    return decodeURIComponent(part);
  } catch {
    return part;
  }
}
