// The maps there are, newest first.

import { make } from "../kit/element";
import { ago, count, moment } from "../kit/format";
import { notice, problemNotice } from "../kit/notice";
import { type Address, href } from "../route/address";
import { type Page, heading } from "../route/router";
import { listMaps } from "../service/maps";
import { isAbort } from "../service/problem";
import type { MapRecord } from "../service/types";
import { jobName } from "../jobs/actions";
import { extentOf, sizeOf } from "./space";

export function mapsPage(address: Address): Page {
  let over = new AbortController();
  const content = make("div", {});
  const element = make("div", { class: "page" }, heading("Maps"), content);
  const load = async ({ query }: Address) => {
    over.abort();
    over = new AbortController();
    content.setAttribute("aria-busy", "true");
    try {
      const page = await listMaps({ label: query.get("label"), cursor: query.get("cursor"), limit: 50 }, over.signal);
      const link = (text: string, cursor: string | null) =>
        make("a", { class: "button", href: href(["maps"], { label: query.get("label"), cursor }) }, text);
      content.replaceChildren(
        page.items.length > 0
          ? make("ul", { class: "jobs", "aria-label": "Maps, newest first" }, ...page.items.map(row))
          : nothing(),
        make(
          "nav",
          { class: "pages", "aria-label": "Pages" },
          query.get("cursor") && link("Newest", null),
          page.next_cursor && link("Older", page.next_cursor),
        ),
      );
    } catch (error) {
      if (isAbort(error)) return;
      content.replaceChildren(problemNotice(error, () => void load({ path: [], query })));
    }
    content.removeAttribute("aria-busy");
  };
  void load(address);
  return { title: "Maps", element, update: (address) => void load(address), leave: () => over.abort() };
}

function row(map: MapRecord): HTMLElement {
  const [width, height] = sizeOf(extentOf(map.lattice));
  const size = `${width.toFixed(1)} × ${height.toFixed(1)} m at ${map.lattice.resolution} m, ${map.distance}, ${count(map.fit.observations)} returns`;
  const labels = Object.entries(map.labels).map(([label, value]) =>
    make("span", { class: "label" }, `${label}:${value}`),
  );
  return make(
    "li",
    { class: "job" },
    make(
      "div",
      { class: "job-name" },
      make("a", { class: "name", href: href(["maps", map.id]) }, jobName(map)),
      make("span", { class: "labels" }, ...labels),
    ),
    make(
      "div",
      { class: "job-state" },
      make("span", { class: "doing" }, size),
      map.fit.converged ? null : make("span", { class: "chip accepted" }, "not converged"),
    ),
    make(
      "div",
      { class: "job-time" },
      make("time", { datetime: map.created, title: moment(map.created) }, ago(map.created)),
    ),
  );
}

function nothing(): HTMLElement {
  return notice({
    title: "No maps yet",
    detail: "A job that succeeds makes one.",
    steps: [
      make("a", { class: "button primary", href: "#/submit" }, "Submit scans"),
      make("a", { class: "button", href: "#/jobs" }, "See the jobs"),
    ],
  });
}
