"""`AsyncClient` does what `Client` does; what asks the service is awaited, `evaluate` never is."""

import asyncio
import inspect

import numpy as np
import pytest

from mapfit_client import (
    AsyncClient,
    AsyncJob,
    AsyncMap,
    AsyncPlace,
    Client,
    Job,
    JobFailed,
    Map,
    MapfitError,
    NotDownloaded,
    Place,
)
from mapfit_client.records import JobRecord

from .test_evaluate import assert_same, places
from .world import tiny


def test_from_a_job_to_its_map(url: str) -> None:
    """Several at a time; a map from `wait` or `map` evaluates as it is."""

    async def go() -> None:
        heard: list[JobRecord] = []
        async with AsyncClient(url) as client:
            jobs = await asyncio.gather(*(client.submit(tiny(k, labels={"async": "yes"})) for k in range(3)))
            maps = await asyncio.gather(*(job.wait(progress=heard.append) for job in jobs))
            assert heard[-1]["status"] == "successful"
            fitted = maps[0]
            points = np.array([[1.0, 1.0], [2.0, 0.1], [99.0, 0.0]])
            here = fitted.evaluate(points)
            names = ("distance", "sigma", "gradient", "nearest", "clearance", "observed")
            assert_same(here, await fitted.query(points), names)
            assert_same((await client.map(fitted.id)).evaluate(points), here, names)
            assert (await fitted.ogm(0.5)).data.size and (await fitted.contours())["features"]
            assert set(await fitted.grid(["sigma"])) == {"sigma", "origin", "resolution"}
            assert len(await fitted.poses()) == 2
            assert (await (await client.job(jobs[0].id)).refresh()).ended
            assert (await jobs[0].request())["labels"] == {"async": "yes"}
            listed = [job.id async for job in client.jobs(labels={"async": "yes"}, page_size=2)]
            assert listed == sorted((job.id for job in jobs), reverse=True)
            found = [listed async for listed in client.maps(labels={"async": "yes"}, page_size=2)]
            with pytest.raises(NotDownloaded, match="download"):
                found[0].evaluate(points)
            assert len((await found[0].download()).evaluate(points)) == 3
            await found[0].delete()
            with pytest.raises(MapfitError, match="404"):
                await client.map(found[0].id)

    asyncio.run(go())


def test_a_cancelled_job_has_no_map(url: str) -> None:
    """As with the blocking one."""

    async def go() -> None:
        async with AsyncClient(url) as client:
            job = await client.submit(tiny(map={"distance": "sdf", "resolution": 0.05}))
            await job.cancel()
            with pytest.raises(JobFailed):
                await job.wait(progress=False)

    asyncio.run(go())


def test_a_map_is_the_same_either_way(url: str, vector: Map) -> None:
    """All arrays of a vector map."""

    async def go() -> AsyncMap:
        async with AsyncClient(url) as client:
            return await client.map(vector.id)

    points = places(vector)
    names = ("distance", "sigma", "vector", "vector_covariance")
    assert_same(asyncio.run(go()).evaluate(points), vector.evaluate(points), names)


@pytest.mark.parametrize(
    ("blocking", "awaiting"), [(Client, AsyncClient), (Job, AsyncJob), (Map, AsyncMap), (Place, AsyncPlace)]
)
def test_both_have_the_same_methods(blocking: type, awaiting: type) -> None:
    """With the same parameters; a map is loaded from a file without either."""

    def methods(kind: type) -> dict[str, list[str]]:
        own = inspect.getmembers(kind, inspect.isfunction)
        return {name: list(inspect.signature(method).parameters) for name, method in own if name[0] != "_"}

    assert methods(blocking) == methods(awaiting)
