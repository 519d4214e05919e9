// A form that publishes a map: at a new place, or as an old one's next version.

import { make } from "../kit/element";
import { problemNotice, say } from "../kit/notice";
import { nameOf } from "../map/panel";
import { listMaps } from "../service/maps";
import { NAME_PATTERN, publish } from "../service/places";
import { isAbort } from "../service/problem";
import type { Place } from "../service/types";

/** Maps to choose from. */
const LISTED = 200;

export function publishForm(place: string | null, done: (place: Place) => void, signal: AbortSignal): HTMLElement {
  const name = make("input", {
    type: "text",
    id: "place-name",
    required: true,
    pattern: NAME_PATTERN,
    maxlength: 63,
    autocomplete: "off",
    spellcheck: "false",
    "aria-describedby": "place-hint",
  });
  const map = make("select", { id: "place-map", required: true });
  const note = make("input", { type: "text", id: "place-note", maxlength: 256, autocomplete: "off" });
  const outcome = make("div", {});
  const older = make("input", { type: "text", id: "place-older", autocomplete: "off", spellcheck: "false" });
  // Whichever is named last is meant.
  older.addEventListener("input", () => (map.disabled = older.value.trim() !== ""));
  const others = make(
    "div",
    { class: "stack", hidden: true },
    make("label", { for: "place-older" }, "Or the id of one that is not listed"),
    older,
  );
  void listMaps({ limit: LISTED }, signal).then(
    ({ items, next_cursor }) => {
      map.replaceChildren(...items.map((one) => make("option", { value: one.id }, nameOf(one))));
      others.hidden = next_cursor === null;
    },
    (error: unknown) => {
      if (isAbort(error)) return;
      others.hidden = false;
      outcome.replaceChildren(problemNotice(error));
    },
  );
  const submit = async (event: Event) => {
    event.preventDefault();
    outcome.replaceChildren();
    try {
      const published = await publish(
        place ?? name.value,
        older.value.trim() || map.value,
        note.value.trim(),
        place === null,
      );
      say(`Published at ${published.name} as version ${published.version}`);
      note.value = "";
      done(published);
    } catch (error) {
      outcome.replaceChildren(problemNotice(error));
    }
  };
  return make(
    "form",
    { class: "stack", onsubmit: (event: Event) => void submit(event) },
    place === null ? make("label", { for: "place-name" }, "Name") : null,
    place === null ? name : null,
    place === null
      ? make(
          "p",
          { class: "note", id: "place-hint" },
          "Small letters, digits, dot, dash, underscore; a letter or digit first.",
        )
      : null,
    make("label", { for: "place-map" }, "Map"),
    map,
    others,
    make("label", { for: "place-note" }, "Note"),
    note,
    outcome,
    make("button", { type: "submit", class: "primary" }, "Publish"),
  );
}
