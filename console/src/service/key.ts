// The API key, for this tab's session alone: it goes when the tab is closed, and no other site or tab can read it.

const NAME = "mapfit-key";
const changes = new EventTarget();

export function key(): string | null {
  return sessionStorage.getItem(NAME);
}

export function setKey(key: string | null): void {
  if (key) sessionStorage.setItem(NAME, key);
  else sessionStorage.removeItem(NAME);
  changes.dispatchEvent(new Event("change"));
}

export function onKey(changed: () => void): void {
  changes.addEventListener("change", changed);
}

/** What a request carries for it. */
export function credentials(): Record<string, string> {
  const value = key();
  return value ? { authorization: `Bearer ${value}` } : {};
}
