// What the map says about a point, or the ruler about a line.

import { make } from "../kit/element";
import { coordinate, degrees, length } from "../kit/format";
import { notice, problemNotice } from "../kit/notice";
import { queryMap } from "../service/maps";
import { isAbort } from "../service/problem";
import type { Answers, Kind, Point } from "../service/types";

export interface Answer {
  at: Point;
  distance: number | null;
  sigma: number | null;
  gradient: Point | null;
  nearest: Point | null;
  clearance: number | null;
  observed: boolean | null;
}

const FIELDS = ["distance", "sigma", "gradient", "nearest", "clearance", "observed"];

export async function answerAt(id: string, at: Point, kind: Kind, signal: AbortSignal): Promise<Answer> {
  return firstOf(at, await queryMap(id, [at], kind, FIELDS, signal));
}

export function firstOf(at: Point, answers: Answers): Answer {
  const first = <T>(values: (T | null)[] | undefined) => values?.[0] ?? null;
  return {
    at,
    distance: first(answers.distance),
    sigma: first(answers.sigma),
    gradient: first(answers.gradient),
    nearest: first(answers.nearest),
    clearance: first(answers.clearance),
    observed: first(answers.observed),
  };
}

/** The panel that tells it; what it shows is read out when it changes. */
export class AnswerPanel {
  readonly element = make("div", { class: "answer", role: "status", "aria-live": "polite" });
  private asking: AbortController | null = null;
  private shown = "";

  constructor(
    private readonly id: string,
    private readonly found: (answer: Answer | null) => void,
    private readonly forget: () => void,
  ) {
    this.clear();
  }

  clear(): void {
    this.asking?.abort();
    this.shown = "";
    this.element.replaceChildren(
      make("p", { class: "note" }, "Click the map, or press Enter on it, to ask about a point."),
    );
    this.found(null);
  }

  async ask(at: Point, kind: Kind): Promise<void> {
    const wanted = JSON.stringify([at, kind]);
    if (wanted === this.shown) return;
    this.shown = wanted;
    this.asking?.abort();
    const asking = new AbortController();
    this.asking = asking;
    try {
      const answer = await answerAt(this.id, at, kind, asking.signal);
      this.found(answer);
      this.element.replaceChildren(
        ...describe(answer, kind),
        make("button", { type: "button", class: "small", onclick: this.forget }, "Clear the point"),
      );
    } catch (error) {
      if (isAbort(error)) return;
      this.shown = "";
      this.found({ at, distance: null, sigma: null, gradient: null, nearest: null, clearance: null, observed: false });
      this.element.replaceChildren(problemNotice(error, () => void this.ask(at, kind)));
    }
  }
}

/** The answer in a few words, for the map's edge. */
export function brief({ distance, sigma, observed }: Answer): string {
  if (observed === null) return "outside this map";
  if (distance === null) return "";
  return `${length(distance)}${sigma === null ? "" : ` ± ${length(sigma)}`}${observed ? "" : ", unseen"}`;
}

export function describe(answer: Answer, kind: Kind): HTMLElement[] {
  const { at, distance, sigma, gradient, nearest, clearance, observed } = answer;
  const place = `(${coordinate(at[0])}, ${coordinate(at[1])}) m`;
  if (observed === null)
    return [
      notice({
        title: "Outside this map",
        detail: `${place} lies beyond its lattice. Ask nearer to the coloured part.`,
      }),
    ];
  const facts: [string, string][] = [];
  if (distance !== null) facts.push(["Distance", `${length(distance)}${sigma === null ? "" : ` ± ${length(sigma)}`}`]);
  if (clearance !== null) facts.push(["Clearance", length(clearance)]);
  if (nearest) facts.push(["Nearest surface", `(${coordinate(nearest[0])}, ${coordinate(nearest[1])}) m`]);
  if (gradient) {
    facts.push([
      "Gradient",
      `(${coordinate(gradient[0])}, ${coordinate(gradient[1])}), towards ${degrees(Math.atan2(gradient[1], gradient[0]))}`,
    ]);
  }
  facts.push(["Point", place]);
  const list = make(
    "dl",
    { class: "facts" },
    ...facts.map(([name, fact]) => make("div", {}, make("dt", {}, name), make("dd", {}, fact))),
  );
  const unseen =
    !observed &&
    notice({ title: "Nobody looked here", detail: "What stands here is a smooth continuation, not a measurement." });
  const which = make("p", { class: "note" }, `± is one standard deviation, ${kind}.`);
  return [unseen || null, list, sigma === null ? null : which].filter((part): part is HTMLElement => part !== null);
}

/** The ruler's panel. */
export function describeRuler(from: Point, to: Point | null): HTMLElement {
  if (!to) return make("p", {}, `From (${coordinate(from[0])}, ${coordinate(from[1])}) m; take the other end.`);
  const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
  const facts: [string, string][] = [
    ["Length", length(Math.hypot(dx, dy))],
    ["Along x, y", `${length(dx)}, ${length(dy)}`],
    ["Direction", degrees(Math.atan2(dy, dx))],
  ];
  return make(
    "dl",
    { class: "facts" },
    ...facts.map(([name, fact]) => make("div", {}, make("dt", {}, name), make("dd", {}, fact))),
  );
}
