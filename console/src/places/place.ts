// One place: which map it has, the versions before, publication and rolling back.

import { make } from "../kit/element";
import { ask } from "../kit/dialog";
import { downloadList } from "../kit/downloads";
import { moment } from "../kit/format";
import { problemNotice, say } from "../kit/notice";
import { type Address, href } from "../route/address";
import { type Page, heading } from "../route/router";
import { abilities } from "../service/abilities";
import { deletePlace, getPlace, listVersions, placePath, rollBack } from "../service/places";
import { Problem, isAbort } from "../service/problem";
import type { Place } from "../service/types";
import { lacking } from "./list";
import { publishForm } from "./publish";

export function placePage({ path }: Address): Page {
  const name = path[1] ?? "";
  const over = new AbortController();
  const content = make("div", {}, make("p", { role: "status" }, "Loading the place…"));
  const element = make(
    "div",
    { class: "page narrow" },
    make("p", { class: "crumb" }, make("a", { href: "#/places" }, "Places")),
    heading(name),
    content,
  );
  let cursor: string | null = null;
  const load = async () => {
    try {
      if (!(await abilities()).has("get", "/v1/places/{name}")) return content.replaceChildren(lacking());
      const [place, versions] = await Promise.all([
        getPlace(name, over.signal),
        listVersions(name, cursor, over.signal),
      ]);
      const older = () => {
        cursor = versions.next_cursor;
        void load();
      };
      content.replaceChildren(
        make(
          "p",
          {},
          `Version ${place.version}, published ${moment(place.published)}: `,
          make("a", { href: href(["maps", place.map_id]) }, "its map"),
        ),
        make("h2", {}, "Versions"),
        make(
          "ul",
          { class: "jobs", "aria-label": "Versions, newest first" },
          ...versions.items.map((version) => row(place, version, () => void load())),
        ),
        make(
          "p",
          { class: "actions" },
          versions.next_cursor ? make("button", { type: "button", onclick: older }, "Older") : null,
        ),
        make("h2", {}, "Publish the next version"),
        publishForm(name, () => void load(), over.signal),
        make("h2", {}, "What robots ask"),
        downloadList([
          { title: "The place as it is now", format: "JSON", path: placePath(name), file: `${name}.json` },
        ]),
        make(
          "p",
          { class: "actions" },
          make("button", { type: "button", onclick: () => void remove(name) }, "Delete the place"),
        ),
      );
    } catch (error) {
      if (!isAbort(error)) content.replaceChildren(problemNotice(error, () => void load()));
    }
  };
  void load();
  return { title: name, element, leave: () => over.abort() };
}

function row(place: Place, version: Place, changed: () => void): HTMLElement {
  const current = version.version === place.version;
  const back = make(
    "button",
    {
      type: "button",
      "aria-label": `Roll back to version ${version.version}`,
      onclick: () => void backTo(place, version.version, changed),
    },
    "Roll back",
  );
  return make(
    "li",
    { class: "job" },
    make(
      "div",
      { class: "job-name" },
      make("a", { class: "name", href: href(["maps", version.map_id]) }, `Version ${version.version}`),
      current ? make("span", { class: "chip successful" }, "now") : null,
    ),
    make("div", { class: "job-state" }, make("span", { class: "doing" }, version.note ?? "")),
    make("div", { class: "job-time" }, moment(version.published)),
    make("div", { class: "actions" }, current ? null : back),
  );
}

async function backTo(place: Place, version: number, changed: () => void): Promise<void> {
  const sure = await ask({
    title: `Roll ${place.name} back to version ${version}?`,
    detail: "That version's map is published again, as a new version. Robots that ask get it at once.",
    yes: "Roll back",
    no: "Leave it",
  });
  if (!sure) return;
  await attempt(async () => {
    const now = await rollBack(place.name, version);
    say(`${place.name} is at version ${now.version}, the map of version ${version}`);
  });
  changed();
}

async function remove(name: string): Promise<void> {
  const sure = await ask({
    title: `Delete the place ${name}?`,
    detail: "Robots that ask for it get nothing. Its maps stay.",
    yes: "Delete it",
    no: "Keep it",
  });
  if (!sure) return;
  await attempt(async () => {
    await deletePlace(name);
    location.hash = "#/places";
  });
}

async function attempt(act: () => Promise<void>): Promise<void> {
  try {
    await act();
  } catch (error) {
    const problem = Problem.of(error);
    say(`${problem.title}. ${problem.detail}`);
  }
}
