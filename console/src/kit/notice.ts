// What is said where something is missing: the reason, and the next step.

import { Problem } from "../service/problem";
import { type Child, make } from "./element";

export interface Notice {
  title: string;
  detail?: Child;
  steps?: Child[];
  /** `alert` is read out at once. */
  role?: "alert" | "status" | "note";
}

export function notice({ title, detail, steps = [], role = "note" }: Notice): HTMLElement {
  return make(
    "div",
    { class: "notice", role },
    make("p", { class: "notice-title" }, title),
    detail ? make("div", {}, detail) : null,
    steps.length > 0 ? make("p", { class: "actions" }, ...steps) : null,
  );
}

/** A problem in the service's words, every fault listed, with what to do next. */
export function problemNotice(error: unknown, retry?: () => void): HTMLElement {
  const problem = Problem.of(error);
  const faults = problem.errors.map((fault) =>
    make("li", {}, make("code", {}, fault.pointer ?? fault.parameter ?? ""), ` ${fault.detail}`),
  );
  const steps: Child[] = [];
  if (problem.status === 401) steps.push(make("a", { class: "button", href: "#/key" }, "Enter an API key"));
  if (problem.status === 403) steps.push(make("a", { class: "button", href: "#/key" }, "Use another API key"));
  if (retry) steps.push(make("button", { type: "button", onclick: retry }, "Try again"));
  return notice({
    title: problem.title,
    detail: make("div", {}, make("p", {}, problem.detail), faults.length > 0 ? make("ul", {}, ...faults) : null),
    steps,
    role: "alert",
  });
}

/** Says something aloud that happened on the page, and shows it for a while. */
export function say(text: string): void {
  const region = document.getElementById("said");
  if (!region) return;
  const line = make("p", {}, text);
  region.replaceChildren(line);
  setTimeout(() => line.remove(), 6000);
}
