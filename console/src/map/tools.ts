// What a click does: ask about a point, or measure.

import { make } from "../kit/element";

export function toolbar(ruling: (on: boolean) => void): { element: HTMLElement } {
  const tool = (name: string, text: string, on: boolean) => {
    const input = make("input", { type: "radio", name: "tool", value: name, checked: !on, onchange: () => ruling(on) });
    return make("label", { class: "choice" }, input, make("span", {}, text));
  };
  const element = make(
    "fieldset",
    { class: "tools choices" },
    make("legend", { class: "hidden" }, "What a click does"),
    tool("ask", "Ask", false),
    tool("ruler", "Ruler", true),
  );
  return { element };
}
