// Which page is open. A page that stays open while its query changes is told so, and keeps its state and focus.

import { make } from "../kit/element";
import { problemNotice } from "../kit/notice";
import { type Address, parse } from "./address";

export interface Page {
  title: string;
  element: HTMLElement;
  /** The same page at another address: Back, a filter, a layer. */
  update?(address: Address): void;
  /** Aborts what is under way. */
  leave?(): void;
}

export type Open = (address: Address) => Page | Promise<Page>;

/** Routes by pattern; `:` stands for any one part. */
export type Routes = [pattern: string, open: Open][];

export class Router {
  private page: Page | null = null;
  private place = "";
  private opening = 0;

  constructor(
    private readonly main: HTMLElement,
    private readonly routes: Routes,
  ) {
    addEventListener("hashchange", () => void this.go());
  }

  /** Goes where the address bar says. */
  async go(): Promise<void> {
    const address = parse(location.hash);
    const place = address.path.join("/");
    mark(address.path[0] ?? "jobs");
    if (this.page && place === this.place && this.page.update) {
      this.page.update(address);
      return;
    }
    this.page?.leave?.();
    this.page = null;
    this.place = place;
    const opening = ++this.opening;
    const page = await this.open(address);
    // Someone went on while a page's code was loading.
    if (opening !== this.opening) {
      page.leave?.();
      return;
    }
    const first = this.main.childElementCount === 0;
    this.page = page;
    document.title = `${page.title} · mapfit`;
    this.main.replaceChildren(page.element);
    scrollTo(0, 0);
    // Who goes to another page by keyboard or ear begins at its heading; the first page leaves focus to the browser.
    if (!first) this.main.querySelector<HTMLElement>("h1")?.focus();
    // The address may have changed while the page was opened.
    if (parse(location.hash).query.toString() !== address.query.toString()) void this.go();
  }

  private async open(address: Address): Promise<Page> {
    const open = this.routes.find(([pattern]) => matches(pattern, address.path))?.[1];
    try {
      return open ? await open(address) : missing();
    } catch (error) {
      const element = make(
        "div",
        { class: "page" },
        heading("Not shown"),
        problemNotice(error, () => location.reload()),
      );
      return { title: "Not shown", element };
    }
  }
}

/** A page's heading, which takes focus when the page opens. */
export function heading(text: string): HTMLHeadingElement {
  return make("h1", { tabindex: -1 }, text);
}

function missing(): Page {
  const home = make("a", { class: "button", href: "#/jobs" }, "To the jobs");
  return { title: "No such page", element: make("div", { class: "page" }, heading("No such page"), home) };
}

function matches(pattern: string, path: string[]): boolean {
  const parts = pattern.split("/").filter(Boolean);
  return parts.length === path.length && parts.every((part, k) => part === ":" || part === path[k]);
}

/** Marks the section of the page in the header. */
function mark(section: string): void {
  for (const link of document.querySelectorAll("header nav a[href^='#/']")) {
    const current = parse(link.getAttribute("href") ?? "").path[0] === section;
    if (current) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
}
