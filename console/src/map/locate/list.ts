// Where each scan was, in words: its pose and how sure, and how well its returns agree with the map.

import { make } from "../../kit/element";
import { coordinate, count, degrees, length } from "../../kit/format";
import type { Point } from "../../service/types";
import type { Located } from "./sighting";

export function locatedRow({ index, found }: Located, look: (at: Point) => void): HTMLElement {
  const { pose, covariance, hypotheses } = found;
  const name = `Scan ${index}`;
  if (!pose || !covariance) {
    return make(
      "li",
      { class: "lost-scan" },
      make("p", { class: "scan-name" }, name, " fits nowhere"),
      make("p", { class: "note" }, agreement(found), " Another place, or too little of this map in view."),
    );
  }
  const sigma = (k: number) => Math.sqrt(Math.max(0, covariance[4 * k] ?? 0));
  const button = make(
    "button",
    { type: "button", class: "small", "aria-label": `Show ${name}`, onclick: () => look([pose.x, pose.y]) },
    name,
  );
  return make(
    "li",
    {},
    make(
      "p",
      { class: "scan-name" },
      button,
      ` (${coordinate(pose.x)}, ${coordinate(pose.y)}) m, ${degrees(pose.theta)}`,
    ),
    make(
      "p",
      { class: "note" },
      `σ ${length(sigma(0))}, ${length(sigma(1))}, ${((sigma(2) * 180) / Math.PI).toFixed(2)}°. ${agreement(found)}`,
      rivals(hypotheses),
      found.converged ? "" : " Not converged.",
    ),
  );
}

/** How the returns agree; chi squared is about its degrees of freedom where noise and map are as they are said to be. */
export function agreement({ used, left_out, chi_squared, degrees_of_freedom }: Located["found"]): string {
  return `${count(used)} used, ${count(left_out)} left out; χ² ${chi_squared.toFixed(0)} of ${count(degrees_of_freedom)}.`;
}

/** The other poses that explain a scan, where the map looks alike from several. */
function rivals([best, ...others]: Located["found"]["hypotheses"]): string {
  if (!best || others.length === 0) return "";
  const percent = (probability: number) => `${Math.round(100 * probability)} %`;
  const texts = others.map(
    ({ pose, probability }) => `(${coordinate(pose.x)}, ${coordinate(pose.y)}) m, ${percent(probability)}`,
  );
  return ` Probability ${percent(best.probability)}; or ${texts.join("; or ")}.`;
}
