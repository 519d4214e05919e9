"""Maps that grow: updates, changes, joins."""

import asyncio
from typing import Any

import pytest

from mapfit_client import AsyncClient, Client, MapfitError

from .world import rooms


def test_an_update_has_a_parent_and_shows_no_change(client: Client) -> None:
    """A job's document serves, with or without its `map`."""
    job = rooms("sdf", 5)
    first = client.submit(job | {"scans": job["scans"][:3]}).wait(progress=False)
    update = first.update(job | {"scans": job["scans"][3:]})
    assert update.request().keys() >= {"scans", "noise"} and "map" not in update.request()
    second = update.wait(progress=False)
    assert (second.record["parent"], second.record["version"]) == (first.id, 2)
    assert second.changes(first)["features"] == [] == first.changes(second.id, probability=0.999)["features"]
    assert second.frames() == []
    with pytest.raises(MapfitError, match="422"):
        second.changes("no-such-map")


def test_a_join_tells_its_frames(url: str) -> None:
    """A map joined to itself is itself; awaited, too."""

    async def go() -> None:
        async with AsyncClient(url) as client:
            first = await (await client.submit(rooms("sdf", 6))).wait(progress=False)
            members: list[dict[str, Any]] = [
                {"id": first.id},
                {"id": first.id, "pose": {"x": 0.1, "y": 0.0, "theta": 0.0}},
            ]
            joined = await (await client.join(members, 0.25, name="twice")).wait(progress=False)
            frames = await joined.frames()
            assert [frame["map_id"] for frame in frames] == [first.id, first.id]
            assert joined.name == "twice" and joined.record["parent"] is None
            assert (await joined.changes(first))["features"] == []

    asyncio.run(go())
