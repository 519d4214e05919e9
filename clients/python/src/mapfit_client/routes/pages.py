"""Lists, page by page, newest first."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ..wire.exchange import Exchange, get_json

Params = Mapping[str, str | list[str]]


class Page(NamedTuple):
    """Some records, and where the next ones begin; None at the end."""

    items: list[Any]
    next_cursor: str | None


def page(path: str, params: Params, cursor: str | None) -> Exchange[Page]:
    """The page at a cursor; the first one at None."""
    here = {**params, "cursor": cursor} if cursor else params
    record = yield from get_json(path, here)
    return Page(record["items"], record["next_cursor"])


def selection(labels: Mapping[str, str] | None, page_size: int, **others: str | None) -> Params:
    """The parameters that choose what is listed."""
    chosen: dict[str, str | list[str]] = {name: value for name, value in others.items() if value is not None}
    if labels:
        chosen["label"] = [f"{key}:{value}" for key, value in labels.items()]
    return {"limit": str(page_size), **chosen}


def box(bbox: Sequence[float] | None) -> str | None:
    """A rectangle as a parameter."""
    return None if bbox is None else ",".join(repr(float(side)) for side in bbox)
