// Where files are dropped, or chosen by those who do not drag.

import { make } from "../kit/element";

const ACCEPTED = ".json,.log,.clf,.txt,.gz,.mcap";

export function dropZone(taken: (file: File) => void, signal: AbortSignal): HTMLElement {
  const input = make("input", { type: "file", id: "file", accept: ACCEPTED, class: "hidden" });
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
    make(
      "p",
      { class: "note" },
      "A job as JSON, a CARMEN log (FLASER lines), an MCAP recording where the service reads them; JSON and logs may be gzipped.",
    ),
    make(
      "p",
      { class: "note" },
      "From a terminal: ",
      make("code", {}, `mapfit submit FILE --wait --url ${location.origin}`),
    ),
  );
  // The whole page takes a drop: a near miss would make the browser open the file.
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
