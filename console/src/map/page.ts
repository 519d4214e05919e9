// A map's page: loads its record, then shows it.

import "../style/map.css";
import "ol/ol.css";

import { make } from "../kit/element";
import { problemNotice } from "../kit/notice";
import type { Address } from "../route/address";
import { type Page, heading } from "../route/router";
import { abilities } from "../service/abilities";
import { getMap } from "../service/maps";
import { isAbort } from "../service/problem";
import { jobName } from "../jobs/actions";
import { MapView } from "./mapview";
import { viewOf } from "./view";

export async function mapPage(address: Address): Promise<Page> {
  const id = address.path[1] ?? "";
  const over = new AbortController();
  const element = make("div", { class: "map-page" });
  let latest = address;
  let view: MapView | null = null;
  let title = "Map";
  const open = async () => {
    try {
      const [record, able] = await Promise.all([getMap(id, over.signal), abilities().catch(() => null)]);
      title = jobName(record);
      document.title = `${title} · mapfit`;
      view = new MapView(record, able, viewOf(latest), over.signal);
      element.replaceChildren(view.element);
      view.begin();
    } catch (error) {
      if (isAbort(error)) return;
      const again = () => void open();
      const home = make("a", { class: "button", href: "#/maps" }, "To the maps");
      element.replaceChildren(
        make("div", { class: "page" }, heading("This map is not shown"), problemNotice(error, again), home),
      );
    }
  };
  element.append(make("div", { class: "page" }, heading("Map"), make("p", { role: "status" }, "Loading the map…")));
  void open();
  const update = (address: Address) => {
    latest = address;
    view?.update(viewOf(address));
  };
  const leave = () => {
    over.abort();
    view?.dispose();
  };
  return { title, element, update, leave };
}
