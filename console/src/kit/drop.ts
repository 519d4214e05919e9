// Where files are dropped, or chosen by those who do not drag.

import { type Child, make } from "./element";

/** `notes` say what is taken; the whole page takes a drop, since a near miss would make the browser open the file. */
export function dropZone(
  accept: string,
  notes: (Child | Child[])[],
  taken: (file: File) => void,
  signal: AbortSignal,
): HTMLElement {
  const input = make("input", { type: "file", id: "file", accept, class: "hidden" });
  input.addEventListener("change", () => {
    const file = input.files?.[0];
    if (file) taken(file);
    // The same file may be chosen again, mended.
    input.value = "";
  });
  const element = make(
    "div",
    { class: "drop" },
    input,
    make(
      "p",
      {},
      make("label", { for: "file", class: "button primary" }, "Choose a file"),
      " or drop it anywhere on this page",
    ),
    ...notes.map((note) => make("p", { class: "note" }, ...[note].flat())),
  );
  const over = (on: boolean) => element.classList.toggle("over", on);
  addEventListener("dragover", (event) => (event.preventDefault(), over(true)), { signal });
  addEventListener("dragleave", (event) => event.relatedTarget === null && over(false), { signal });
  addEventListener(
    "drop",
    (event) => {
      event.preventDefault();
      over(false);
      const file = event.dataTransfer?.files[0];
      if (file) taken(file);
    },
    { signal },
  );
  return element;
}
