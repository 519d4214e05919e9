// The places there are, and a form for a new one.

import { make } from "../kit/element";
import { ago, moment } from "../kit/format";
import { notice, problemNotice } from "../kit/notice";
import { type Address, href } from "../route/address";
import { type Page, heading } from "../route/router";
import { abilities } from "../service/abilities";
import { listPlaces } from "../service/places";
import { isAbort } from "../service/problem";
import type { Place } from "../service/types";
import { publishForm } from "./publish";

export function placesPage(address: Address): Page {
  const over = new AbortController();
  const content = make("div", {}, make("p", { role: "status" }, "Loading the places…"));
  const element = make(
    "div",
    { class: "page" },
    heading("Places"),
    make(
      "p",
      { class: "note" },
      "A place is a name that robots ask for; you decide which map it has. Each publication is a version, and can be rolled back.",
    ),
    content,
  );
  const load = async (address: Address) => {
    try {
      if (!(await abilities()).has("get", "/v1/places")) return content.replaceChildren(lacking());
      const page = await listPlaces(address.query.get("cursor"), over.signal);
      const older =
        page.next_cursor &&
        make("a", { class: "button", href: href(["places"], { cursor: page.next_cursor }) }, "More");
      content.replaceChildren(
        page.items.length > 0
          ? make("ul", { class: "jobs", "aria-label": "Places" }, ...page.items.map(row))
          : notice({ title: "No places yet", detail: "Publish a map below." }),
        make("nav", { class: "pages", "aria-label": "Pages" }, older),
        make("h2", {}, "A new place"),
        publishForm(null, (place) => (location.hash = href(["places", place.name])), over.signal),
      );
    } catch (error) {
      if (!isAbort(error)) content.replaceChildren(problemNotice(error, () => void load(address)));
    }
  };
  void load(address);
  return { title: "Places", element, update: (address) => void load(address), leave: () => over.abort() };
}

function row(place: Place): HTMLElement {
  return make(
    "li",
    { class: "job" },
    make("div", { class: "job-name" }, make("a", { class: "name", href: href(["places", place.name]) }, place.name)),
    make("div", { class: "job-state" }, make("span", { class: "doing" }, `version ${place.version}`)),
    make(
      "div",
      { class: "job-time" },
      make("time", { datetime: place.published, title: moment(place.published) }, ago(place.published)),
    ),
    make(
      "div",
      { class: "actions" },
      make(
        "a",
        { class: "button", href: href(["maps", place.map_id]), "aria-label": `Open map: ${place.name}` },
        "Open map",
      ),
    ),
  );
}

/** A service of a version that has none. */
export function lacking(): HTMLElement {
  return notice({
    title: "This service has no places",
    detail: "Its version does not know them. Maps can be opened and downloaded all the same.",
    steps: [make("a", { class: "button", href: "#/maps" }, "To the maps")],
  });
}
