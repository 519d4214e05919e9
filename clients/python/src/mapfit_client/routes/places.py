"""Places: names under which maps follow one another.

Publishing twice makes two versions, so it is not repeated where nobody knows whether it was carried out.
"""

from ..records import PlaceRecord
from ..wire.exchange import Exchange, address, get_json, with_json


def get(name: str) -> Exchange[PlaceRecord]:
    """A place as it is now."""
    record: PlaceRecord = yield from get_json(address("places", name))
    return record


def publish(name: str, map_id: str, note: str | None) -> Exchange[PlaceRecord]:
    """Publishes a map at a place, which need not be there yet."""
    content = {"map_id": map_id, **({} if note is None else {"note": note})}
    answer = yield with_json("PUT", address("places", name), content, repeatable=False)
    record: PlaceRecord = answer.json()
    return record


def rollback(name: str, version: int) -> Exchange[PlaceRecord]:
    """Publishes an older version's map again, as a new version."""
    answer = yield with_json("POST", address("places", name, "rollback"), {"version": version}, repeatable=False)
    record: PlaceRecord = answer.json()
    return record
