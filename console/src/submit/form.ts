// The form: what the scans cannot say. It begins with what the file says, else with what the command line takes.

import { make } from "../kit/element";
import type { Fault } from "../service/problem";
import type { Distance } from "../service/types";
import { type Field, field, positive, whole } from "./field";
import type { Selection, Settings, Summary } from "./reader";

export interface Form {
  element: HTMLElement;
  settings(): Settings;
  selection(): Selection;
  /** What of a recording is taken: topics and scans. */
  topics(): Record<string, string | number>;
  /** Shows faults at their fields; gives back those that have none. */
  faults(faults: Fault[]): Fault[];
}

export function jobForm(summary: Summary, fileName: string, changed: (selection: boolean) => void): Form {
  const { given, kind } = summary;
  const noise = given?.noise ?? { sigma_x: 0.02, sigma_y: 0.02, sigma_theta: 0.005, sigma_range: 0.02 };
  const labels = Object.entries(given?.labels ?? {})
    .map((pair) => pair.join(":"))
    .join(", ");
  const name = field("Name", "/name", { type: "text", maxlength: 256, value: given?.name ?? stem(fileName) });
  const tags = field(
    "Labels",
    "/labels",
    { type: "text", value: labels, placeholder: "site:hq, floor:2" },
    "key:value, with commas between",
  );
  const resolution = positive(
    "Resolution, m",
    "/map/resolution",
    given?.map?.resolution ?? 0.25,
    "The spacing of control points: no wider than the walls are thick, where both sides were scanned.",
  );
  const sigmas = [
    positive("σ x, m", "/noise/sigma_x", noise.sigma_x),
    positive("σ y, m", "/noise/sigma_y", noise.sigma_y),
    positive("σ heading, rad", "/noise/sigma_theta", noise.sigma_theta),
    positive("σ range, m", "/noise/sigma_range", noise.sigma_range),
  ] as const;
  const steps = whole("Steps at most", "/fit/max_iterations", Number(given?.fit?.["max_iterations"] ?? 100), 1);
  const priority = whole("Priority", "/priority", given?.priority ?? 0, -1000, "Higher runs first");
  const chosen = [
    whole("Every so many scans", "/every", 1, 1),
    whole("First scan", "/from", 0, 0),
    whole(
      "One past the last",
      "/to",
      "",
      1,
      kind === "log" ? `Of ${summary.of}; empty: to the end` : "Empty: to the end",
    ),
  ] as const;
  const topic = [
    field("Scan topic", "/scan_topic", { type: "text" }, "Empty: the only one"),
    field("Pose topic", "/pose_topic", { type: "text" }, "Empty: the only one"),
  ] as const;
  const distance = radios("distance", given?.map?.distance ?? "vdf", [
    ["vdf", "Building", "vector distance: thin walls, space on both sides"],
    ["sdf", "Room", "signed distance: a place with an inside"],
  ]);
  const poses = radios("poses", String(given?.fit?.["poses"] ?? "refined"), [
    ["refined", "Refine poses", "they are fitted with the map"],
    ["fixed", "Keep poses", "they are taken as they are"],
  ]);
  const all: Field[] = [
    name,
    tags,
    resolution,
    ...sigmas,
    steps,
    priority,
    ...(kind === "job" ? [] : chosen),
    ...(kind === "recording" ? topic : []),
  ];
  const row = (...fields: readonly Field[]) => make("div", { class: "form-row" }, ...fields.map((one) => one.element));
  const group = (title: string, ...content: HTMLElement[]) =>
    make("fieldset", {}, make("legend", {}, title), ...content);
  const element = make(
    "div",
    { class: "job-form" },
    row(name, tags),
    group("What was scanned", distance.element, row(resolution)),
    group("Noise: standard deviations", row(...sigmas)),
    kind !== "job" ? group("Scans taken", row(...chosen)) : null,
    kind === "recording" ? group("Topics", row(...topic)) : null,
    make("details", {}, make("summary", {}, "More"), group("Poses", poses.element), row(steps, priority)),
  );
  element.addEventListener("input", (event) => changed(chosen.some((one) => one.input === event.target)));
  const number = (one: Field) => Number(one.input.value);
  const settings = (): Settings => {
    const pairs = tags.input.value
      .split(",")
      .map((tag) => tag.trim())
      .filter(Boolean)
      .map((tag) => tag.split(/:(.*)/s));
    const [sigma_x, sigma_y, sigma_theta, sigma_range] = sigmas.map(number) as [number, number, number, number];
    return {
      name: name.input.value.trim() || null,
      ...(pairs.length > 0 || labels
        ? { labels: Object.fromEntries(pairs.map(([label = "", value = ""]) => [label.trim(), value.trim()])) }
        : {}),
      noise: { sigma_x, sigma_y, sigma_theta, sigma_range },
      map: { distance: distance.value() as Distance, resolution: number(resolution) },
      fit: { poses: poses.value(), max_iterations: number(steps) || 100 },
      ...(number(priority) ? { priority: number(priority) } : {}),
    };
  };
  const selection = () => {
    const [every, from, to] = chosen;
    return {
      every: Math.max(1, number(every) || 1),
      from: Math.max(0, number(from) || 0),
      to: to.input.value ? number(to) : null,
    };
  };
  const topics = () => {
    const given = topic.map((one) => [one.pointer.slice(1), one.input.value.trim()] as const);
    const { every, from, to } = selection();
    return { ...Object.fromEntries(given.filter(([, value]) => value)), every, from, ...(to === null ? {} : { to }) };
  };
  const faults = (faults: Fault[]) => {
    for (const one of all) one.fault(null);
    const left = faults.filter((fault) => {
      const at = all.find((one) => fault.pointer === one.pointer || fault.pointer?.startsWith(`${one.pointer}/`));
      at?.fault(fault.detail);
      return !at;
    });
    all.find((one) => one.input.hasAttribute("aria-invalid"))?.input.focus();
    return left;
  };
  return { element, settings, selection, topics, faults };
}

function stem(fileName: string): string {
  return fileName.replace(/\.gz$/i, "").replace(/\.(json|log|clf|txt|mcap)$/i, "");
}

function radios(name: string, chosen: string, options: [value: string, title: string, hint: string][]) {
  const inputs = options.map(([value]) => make("input", { type: "radio", name, value, checked: value === chosen }));
  const rows = options.map(([, title, hint], k) =>
    make("label", { class: "check" }, inputs[k], make("span", {}, title, " ", make("span", { class: "note" }, hint))),
  );
  return { element: make("div", {}, ...rows), value: () => inputs.find((input) => input.checked)?.value ?? chosen };
}
