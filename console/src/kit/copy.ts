// Lines to copy.

import { make } from "./element";
import { say } from "./notice";

/** A line of code with a button that copies it. `what` names it for those who cannot see it. */
export function copyable(line: string, what: string): HTMLElement {
  const copy = async () => {
    try {
      await navigator.clipboard.writeText(line);
      say(`Copied: ${what}`);
    } catch {
      // No clipboard without a secure context: select the line, so that Ctrl-C does it.
      getSelection()?.selectAllChildren(code);
      say("Press Ctrl-C to copy");
    }
  };
  // A line that is wider than its box is scrolled by keyboard, so it can have focus.
  const code = make("code", { tabindex: 0, role: "region", "aria-label": what }, line);
  const button = make(
    "button",
    { type: "button", class: "small", "aria-label": `Copy: ${what}`, onclick: copy },
    "Copy",
  );
  return make("div", { class: "copyable" }, code, button);
}
