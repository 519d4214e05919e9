// Numbers as people read them: units chosen by size, never more digits than mean something.

const MINUS = "\u2212";

/** A length: millimetres below a decimetre, metres above. */
export function length(metres: number): string {
  const size = Math.abs(metres);
  if (size < 0.1) return `${signed((metres * 1000).toFixed(size < 0.01 ? 1 : 0))} mm`;
  return `${signed(metres.toFixed(size < 100 ? 3 : 1))} m`;
}

/** A position's coordinate, to the millimetre. */
export function coordinate(metres: number): string {
  return signed(metres.toFixed(3));
}

export function degrees(radians: number): string {
  return `${signed(((radians * 180) / Math.PI).toFixed(1))}°`;
}

/** With a true minus sign, and no negative nought. */
function signed(number: string): string {
  return Number(number) === 0 ? number.replace("-", "") : number.replace("-", MINUS);
}

// Made once: to make one takes longer than to draw a row.
const COUNT = new Intl.NumberFormat("en-GB");
const DAY = new Intl.DateTimeFormat("en-GB", { day: "numeric", month: "short", year: "numeric" });
const MOMENT = new Intl.DateTimeFormat("en-GB", { dateStyle: "medium", timeStyle: "medium" });

export function count(number: number): string {
  return COUNT.format(number);
}

/** `1 scan`, `2 scans`. */
export function counted(number: number, noun: string): string {
  return `${count(number)} ${noun}${number === 1 ? "" : "s"}`;
}

export function bytes(size: number): string {
  const units = ["bytes", "KiB", "MiB", "GiB"];
  let unit = 0;
  while (size >= 1024 && unit < units.length - 1) {
    size /= 1024;
    unit += 1;
  }
  return `${unit === 0 || size >= 100 ? Math.round(size) : size.toFixed(1)} ${units[unit]}`;
}

export function duration(seconds: number): string {
  if (seconds < 10) return `${seconds.toFixed(1)} s`;
  if (seconds < 60) return `${Math.round(seconds)} s`;
  const minutes = Math.floor(seconds / 60);
  if (minutes < 60) return `${minutes} min ${Math.round(seconds % 60)} s`;
  return `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

/** How long ago, in words. */
export function ago(time: string | null, now = Date.now()): string {
  if (!time) return "";
  const seconds = Math.max(0, (now - Date.parse(time)) / 1000);
  if (seconds < 45) return "just now";
  if (seconds < 3600) return `${Math.max(1, Math.round(seconds / 60))} min ago`;
  if (seconds < 86400) return `${Math.round(seconds / 3600)} h ago`;
  if (seconds < 7 * 86400) return `${Math.round(seconds / 86400)} d ago`;
  return DAY.format(new Date(time));
}

export function moment(time: string | null): string {
  return time ? MOMENT.format(new Date(time)) : "";
}
