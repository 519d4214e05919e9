// What of the jobs is shown. The filter is the address: it can be linked, and Back undoes it.

import { make } from "../kit/element";
import type { JobFilter } from "../service/jobs";
import { STATUSES } from "../service/types";
import { statusWord } from "./status";

export function filterBar(changed: (filter: JobFilter) => void): {
  element: HTMLElement;
  show(filter: JobFilter): void;
} {
  const choices = ["", ...STATUSES].map((status) => {
    const input = make("input", { type: "radio", name: "status", value: status, onchange: () => changed({ status }) });
    return {
      status,
      input,
      element: make("label", { class: "choice" }, input, make("span", {}, status ? statusWord(status) : "all")),
    };
  });
  const label = make("input", {
    type: "search",
    id: "label-filter",
    placeholder: "site:hq",
    spellcheck: "false",
    autocomplete: "off",
  });
  label.addEventListener("input", () => label.setCustomValidity(""));
  const submit = (event: Event) => {
    event.preventDefault();
    const text = label.value.trim();
    // The service takes key:value alone, so nothing else is sent.
    if (text && !/^[^:]+:/.test(text)) {
      label.setCustomValidity("A label is key:value, for example site:hq");
      label.reportValidity();
      return;
    }
    changed({ label: text });
  };
  label.addEventListener("search", () => label.value === "" && changed({ label: "" }));
  const element = make(
    "form",
    { class: "filter", role: "search", onsubmit: submit },
    make(
      "fieldset",
      { class: "choices" },
      make("legend", { class: "hidden" }, "State"),
      ...choices.map((choice) => choice.element),
    ),
    make(
      "div",
      { class: "label-filter" },
      make("label", { for: "label-filter" }, "Label"),
      label,
      make("button", { type: "submit" }, "Filter"),
    ),
  );
  const show = (filter: JobFilter) => {
    for (const { status, input } of choices) input.checked = (filter.status ?? "") === status;
    if (document.activeElement !== label) label.value = filter.label ?? "";
  };
  return { element, show };
}
