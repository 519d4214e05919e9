// Downloads, each with the lines that do the same from a terminal and from Python.

import { request } from "../service/client";
import { key } from "../service/key";
import { Problem } from "../service/problem";
import { copyable } from "./copy";
import { make } from "./element";
import { say } from "./notice";

export interface Download {
  title: string;
  format: string;
  path: string;
  /** What it is saved as. */
  file: string;
  note?: string;
}

/** The line for a terminal. A key is never in it: it is read from the environment. */
export function curlLine(download: Download, origin: string, withKey: boolean): string {
  const header = withKey ? ` -H "Authorization: Bearer $MAPFIT_KEY"` : "";
  return `curl -sf${header} "${origin}${download.path}" -o ${download.file}`;
}

/** The same with Python's own library. */
export function pythonLine(download: Download, origin: string, withKey: boolean): string {
  const url = `"${origin}${download.path}"`;
  if (!withKey) return `import urllib.request; urllib.request.urlretrieve(${url}, "${download.file}")`;
  const asked = `urllib.request.Request(${url}, headers={"Authorization": "Bearer " + os.environ["MAPFIT_KEY"]})`;
  return `import os, urllib.request; open("${download.file}", "wb").write(urllib.request.urlopen(${asked}).read())`;
}

export function downloadList(downloads: Download[]): HTMLElement {
  return make("ul", { class: "downloads" }, ...downloads.map(item));
}

function item(download: Download): HTMLElement {
  const { title, format, path, file, note } = download;
  const link = make("a", { href: path, download: file }, `${title} `, make("span", { class: "format" }, format));
  link.addEventListener("click", (event) => {
    // A link cannot carry a key, so with one the file is fetched here and handed over.
    if (key() === null) return;
    event.preventDefault();
    void fetchFile(download);
  });
  const withKey = key() !== null;
  const lines = make(
    "details",
    {},
    make("summary", { "aria-label": `curl, Python: ${title}, ${format}` }, "curl, Python"),
    copyable(curlLine(download, location.origin, withKey), `curl for ${title}, ${format}`),
    copyable(pythonLine(download, location.origin, withKey), `Python for ${title}, ${format}`),
  );
  return make("li", {}, link, note ? make("p", { class: "note" }, note) : null, lines);
}

async function fetchFile({ path, file }: Download): Promise<void> {
  try {
    const url = URL.createObjectURL(await (await request(path)).blob());
    make("a", { href: url, download: file }).click();
    setTimeout(() => URL.revokeObjectURL(url), 60_000);
  } catch (error) {
    const problem = Problem.of(error);
    say(`${problem.title}. ${problem.detail}`);
  }
}
