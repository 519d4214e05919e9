// Light or dark, as the system says; pictures of the service follow it too.

export type Theme = "light" | "dark";

const dark = () => matchMedia("(prefers-color-scheme: dark)");

export function theme(): Theme {
  return dark().matches ? "dark" : "light";
}

/** Calls back whenever it changes, until the signal is aborted. */
export function onTheme(changed: (theme: Theme) => void, signal: AbortSignal): void {
  dark().addEventListener("change", () => changed(theme()), { signal });
}

export function isStill(): boolean {
  return matchMedia("(prefers-reduced-motion: reduce)").matches;
}
