// A map in a few words: what it is, and whether to trust it.

import { make } from "../kit/element";
import { counted, duration, moment } from "../kit/format";
import { notice } from "../kit/notice";
import { href } from "../route/address";
import type { MapRecord } from "../service/types";
import { extentOf, sizeOf } from "./space";

export function facts(map: MapRecord): HTMLElement {
  const { fit, lattice } = map;
  const [width, height] = sizeOf(extentOf(lattice));
  const distance = map.distance === "sdf" ? "signed distance" : "vector distance";
  const line = [
    `${width.toFixed(1)} × ${height.toFixed(1)} m, ${distance}, a control point every ${lattice.resolution} m`,
    `${counted(fit.observations, "return")}; fitted in ${duration(fit.seconds)}`,
  ];
  return make(
    "div",
    { class: "map-facts" },
    ...line.map((text) => make("p", {}, text)),
    make(
      "p",
      {},
      `Version ${map.version ?? 1}, ${moment(map.created)}: `,
      make("a", { href: href(["jobs", map.job_id]) }, "its job"),
    ),
    fit.converged
      ? null
      : notice({
          title: "The fit did not converge",
          detail: `${fit.unconverged ?? "It stopped short of a minimum."} More steps (fit.max_iterations) or another resolution may help.`,
        }),
  );
}
