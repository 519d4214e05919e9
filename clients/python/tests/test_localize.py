"""Where scans were taken, asked of a running service."""

import asyncio
import math
from typing import Any

import numpy as np
import pytest

from mapfit_client import AsyncClient, LocalizedPose, Map, MapfitError

from .world import NOISE, rooms


def scans(world: Map, seed: int) -> list[dict[str, Any]]:
    """Scans of a map's world that it was not made of; their poses are reported, a little off."""
    taken: list[dict[str, Any]] = rooms(world.distance, seed)["scans"]
    return taken


def off(found: LocalizedPose, scan: dict[str, Any]) -> float:
    """How far a pose lies from the reported one, metres."""
    assert found.pose is not None
    return math.hypot(found.pose["x"] - scan["pose"]["x"], found.pose["y"] - scan["pose"]["y"])


def test_a_scan_is_located_from_a_rough_pose(fitted: Map) -> None:
    """With a covariance that is symmetric, positive definite and smaller than what was known before."""
    prior = {**NOISE, "sigma_x": 0.2, "sigma_y": 0.2, "sigma_theta": 0.05}
    taken = scans(fitted, 31)
    rough = [{**scan, "pose": {**scan["pose"], "x": scan["pose"]["x"] + 0.1}} for scan in taken]
    for scan, found in zip(taken, fitted.localize(rough, noise=prior), strict=True):
        assert found.converged and found.used > 50 and off(found, scan) < 0.06
        assert found.covariance is not None and found.covariance.shape == (3, 3)
        assert np.allclose(found.covariance, found.covariance.T)
        assert (np.linalg.eigvalsh(found.covariance) > 0).all()
        assert found.covariance[0, 0] < 0.2**2 and found.chi_squared is not None and found.degrees_of_freedom


def test_from_nowhere_all_that_looks_alike_is_named(fitted: Map) -> None:
    """An empty room looks the same turned by half a turn about (3, 2); a wall seen from other places does not."""
    [scan, *_] = scans(fitted, 32)
    [found] = fitted.localize([{**scan, "pose": None}], noise=NOISE, hypotheses=3)
    assert found.converged and found.pose == found.hypotheses[0]["pose"]
    chances = [hypothesis["probability"] for hypothesis in found.hypotheses]
    assert chances == sorted(chances, reverse=True) and abs(sum(chances) - 1) < 1e-6
    likely = [one["pose"] for one in found.hypotheses if one["probability"] > 0.01]
    x, y = scan["pose"]["x"], scan["pose"]["y"]
    answers = [(x, y), (6 - x, 4 - y)] if fitted.distance == "sdf" else [(x, y)]
    assert len(likely) == len(answers)
    for answer in answers:
        assert min(math.dist(answer, (pose["x"], pose["y"])) for pose in likely) < 0.06


def test_a_scan_of_another_place_is_nowhere(fitted: Map) -> None:
    """No pose is better than a wrong one."""
    scan = {**scans(fitted, 33)[0], "pose": None}
    scan["ranges"] = np.where(np.arange(len(scan["ranges"])) % 2 == 0, 0.4, 25.0)
    [found] = fitted.localize([scan], noise=NOISE)
    assert not found.converged and found.pose is None and found.covariance is None


def test_numpy_and_what_the_map_refuses(vector: Map) -> None:
    """Arrays are welcome, kinds are told, faults have pointers."""
    scan = scans(vector, 34)[0]
    propagated, posterior = (vector.localize([scan], noise=NOISE, kind=kind)[0] for kind in ("propagated", "posterior"))
    assert propagated.converged and posterior.converged
    with pytest.raises(MapfitError) as refused:
        vector.localize([{**scan, "range_max": -1.0}], noise=NOISE)
    assert any((fault.get("pointer") or "").startswith("/scans/0") for fault in refused.value.problem["errors"])


def test_awaited_it_is_the_same(url: str, signed: Map) -> None:
    """To the last bit."""
    scan = scans(signed, 35)[0]

    async def go() -> list[LocalizedPose]:
        async with AsyncClient(url) as client:
            return await (await client.map(signed.id)).localize([scan], noise=NOISE)

    [awaited], [found] = asyncio.run(go()), signed.localize([scan], noise=NOISE)
    assert awaited.pose == found.pose
    assert awaited.covariance is not None and found.covariance is not None
    assert np.array_equal(awaited.covariance, found.covariance)
