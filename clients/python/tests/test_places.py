"""Places: maps follow one another under a name, and what is published is what is found."""

import asyncio

import pytest

from mapfit_client import AsyncClient, Client, MapfitError

from .world import tiny


def test_a_place_from_its_first_map_to_a_roll_back(client: Client) -> None:
    """Each publication is a version; its map is had without knowing its id."""
    first, second = (client.submit(tiny(seed)).wait(progress=False) for seed in (21, 22))
    place = client.publish("hall-1", first.id, note="first")
    assert (place.name, place.version, place.map_id, place.record["note"]) == ("hall-1", 1, first.id, "first")
    assert place.publish(second.id).version == 2
    found = client.place("hall-1")
    assert (found.version, found.map_id, repr(found)) == (2, second.id, repr(place))
    assert found.map().evaluate([1.0, 1.0]).distance == second.evaluate([1.0, 1.0]).distance
    # What robots drive by is not deleted under them.
    with pytest.raises(MapfitError, match="409"):
        second.delete()
    assert (found.rollback(1).version, found.map_id) == (3, first.id)
    assert place.version == 2, "a record is as it was last heard of"
    with pytest.raises(MapfitError, match="404"):
        client.place("no-such-hall")
    with pytest.raises(MapfitError, match="no version 9"):
        found.rollback(9)


def test_places_are_listed_over_pages(client: Client) -> None:
    """Each once, whatever the pages' size."""
    fitted = client.submit(tiny(23)).wait(progress=False)
    names = [f"listed-{k}" for k in range(5)]
    for name in names:
        client.publish(name, fitted.id)
    listed = [place.name for place in client.places(page_size=2)]
    assert sorted(name for name in listed if name.startswith("listed-")) == names


def test_a_place_awaited(url: str) -> None:
    """Its map is downloaded before it is handed out."""

    async def go() -> None:
        async with AsyncClient(url) as client:
            jobs = await asyncio.gather(*(client.submit(tiny(seed)) for seed in (24, 25)))
            first, second = await asyncio.gather(*(job.wait(progress=False) for job in jobs))
            place = await client.publish("hall-2", first.id)
            assert (await place.publish(second.id, note="next")).record["note"] == "next"
            found = await client.place("hall-2")
            fitted = await found.map()
            assert fitted.evaluate([1.0, 1.0]).distance == second.evaluate([1.0, 1.0]).distance
            assert ((await found.rollback(1)).version, found.map_id) == (3, first.id)
            assert "hall-2" in [place.name async for place in client.places(page_size=1)]

    asyncio.run(go())
