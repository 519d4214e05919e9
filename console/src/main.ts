// The console: one page, which shows what its address says.

import "./style/tokens.css";
import "./style/page.css";
import "./style/controls.css";
import "./style/jobs.css";

import { jobPage } from "./jobs/job";
import { jobsPage } from "./jobs/list";
import { keyPage } from "./key/page";
import { Router } from "./route/router";
import { key, onKey } from "./service/key";

const main = document.querySelector("main") as HTMLElement;
const router = new Router(main, [
  ["", jobsPage],
  ["jobs", jobsPage],
  ["jobs/:", jobPage],
  // What draws maps is loaded when one is opened: the list of jobs is there at once.
  ["maps", async (address) => (await import("./map/list")).mapsPage(address)],
  ["maps/:", async (address) => (await import("./map/page")).mapPage(address)],
  ["submit", async () => (await import("./submit/page")).submitPage()],
  ["places", async (address) => (await import("./places/list")).placesPage(address)],
  ["places/:", async (address) => (await import("./places/place")).placePage(address)],
  ["key", keyPage],
]);

const showKey = () => {
  const link = document.querySelector("header a[href='#/key']");
  if (link) link.textContent = key() ? "Key set" : "Key";
};
onKey(showKey);
showKey();
void router.go();

// The address is the router's, so the skip link does its work by hand.
document.querySelector(".skip")?.addEventListener("click", (event) => {
  event.preventDefault();
  main.focus();
});
