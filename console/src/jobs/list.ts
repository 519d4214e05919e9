// The jobs, newest first: live, filtered, page by page.

import { make, write } from "../kit/element";
import { notice, problemNotice } from "../kit/notice";
import { Rows } from "../kit/rows";
import { type Address, href } from "../route/address";
import { type Page, heading } from "../route/router";
import { type Abilities, abilities } from "../service/abilities";
import type { JobFilter } from "../service/jobs";
import type { Problem } from "../service/problem";
import type { Job, Page as JobsPage } from "../service/types";
import { filterBar } from "./filter";
import { LiveJobs } from "./live";
import { jobRow } from "./row";

export function jobsPage(address: Address): Page {
  let filter = filterOf(address);
  let able: Abilities | null = null;
  void abilities().then(
    (known) => (able = known),
    () => {},
  );

  const list = make("ul", { class: "jobs", "aria-label": "Jobs, newest first" });
  const rows = new Rows<Job>(
    list,
    (job) => job.id,
    (job) =>
      jobRow(
        job,
        () => able,
        () => void live.refresh(),
      ),
  );
  const state = make("span", { class: "live", role: "status" }, "loading");
  const empty = make("div", {});
  const pages = make("nav", { class: "pages", "aria-label": "Pages" });
  const bar = filterBar((changed) => (location.hash = href(["jobs"], { ...filter, cursor: null, ...changed })));
  bar.show(filter);

  const page = (page: JobsPage<Job>) => {
    rows.show(page.items);
    empty.replaceChildren(...(page.items.length === 0 ? [nothing(filter)] : []));
    const links: HTMLAnchorElement[] = [];
    const link = (text: string, cursor: string | null) =>
      links.push(make("a", { class: "button", href: href(["jobs"], { ...filter, cursor }) }, text));
    if (filter.cursor) link("Newest", null);
    if (page.next_cursor) link("Older", page.next_cursor);
    // Refreshed every few seconds: links that say the same stay, and keep focus.
    const same = (k: number) => pages.children[k]?.getAttribute("href") === links[k]?.getAttribute("href");
    if (pages.childElementCount !== links.length || !links.every((_, k) => same(k))) pages.replaceChildren(...links);
    pages.hidden = links.length === 0;
  };
  const trouble = (problem: Problem | null) => {
    state.classList.toggle("lost", problem !== null);
    write(state, problem ? "not up to date, trying again" : "live");
    const refused = problem && (problem.status > 0 || list.childElementCount === 0);
    if (refused) empty.replaceChildren(problemNotice(problem, () => void live.refresh()));
    if (problem && problem.status >= 400 && problem.status < 500) rows.show([]);
  };
  const live = new LiveJobs(filter, { page, trouble, job: (job) => rows.update(job) });

  const head = make("div", { class: "head" }, heading("Jobs"), state);
  const element = make("div", { class: "page" }, head, bar.element, list, empty, pages);
  const update = (address: Address) => {
    filter = filterOf(address);
    bar.show(filter);
    live.show(filter);
  };
  return { title: "Jobs", element, update, leave: () => live.stop() };
}

function filterOf(address: Address): JobFilter {
  const { query } = address;
  return { status: query.get("status"), label: query.get("label"), cursor: query.get("cursor") };
}

/** Why there is no row, and what to do. */
function nothing(filter: JobFilter): HTMLElement {
  if (filter.status || filter.label) {
    return notice({
      title: "No job is like this",
      detail: "The filter leaves nothing.",
      steps: [make("a", { class: "button", href: href(["jobs"]) }, "Show all jobs")],
    });
  }
  return notice({
    title: "No jobs yet",
    detail: make(
      "p",
      {},
      "Drop a laser log here, or send one from a terminal: ",
      make("code", {}, "mapfit submit FILE --wait"),
      ".",
    ),
    steps: [make("a", { class: "button primary", href: "#/submit" }, "Submit scans")],
  });
}
