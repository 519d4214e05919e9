"""Holds every link and picture of a built site to what is there, headings too. Argument: the site's folder."""

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """A page's links, and what of it can be linked to."""

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.ids: set[str] = set()
        self.feed(file.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        known = dict(attrs)
        self.ids |= {known["id"]} if known.get("id") else set()
        self.links += [known[name] for name in ("href", "src") if known.get(name)]


def main(folder: str) -> int:
    site = Path(folder).resolve()
    pages = {file: Page(file) for file in site.rglob("*.html") if file.name not in ("404.html", "toc.html")}
    broken, followed = [], 0
    for file, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            target = target / "index.html" if target.is_dir() else target
            followed += 1
            if not target.is_file() or site not in target.parents:
                broken.append(f"{file.relative_to(site)}: {link} is not there")
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].ids:
                broken.append(f"{file.relative_to(site)}: {link} has no such heading")
    print("\n".join(dict.fromkeys(broken)))
    print(f"{len(pages)} pages, {followed} links, {len(broken)} broken: {site}/index.html")
    return 1 if broken or len(pages) < 10 else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
