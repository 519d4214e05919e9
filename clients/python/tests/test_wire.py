"""What is asked again and when, without a service: answers are made up, time does not pass."""

import asyncio
import json
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from typing import Any

import httpx2
import numpy as np
import pytest

from mapfit_client import AsyncClient, Client, Map, MapfitError, NotReachable
from mapfit_client.routes import jobs

Scripted = httpx2.Response | httpx2.TransportError
JOB: dict[str, Any] = {"id": "j", "name": None, "labels": {}, "status": "accepted", "map_id": None, "problem": None}


class Script:
    """Answers one after the other, and what was asked and how long was slept."""

    def __init__(self, *answers: Scripted, sleeps: list[float]) -> None:
        self._answers = list(answers)
        self.asked: list[httpx2.Request] = []
        self.sleeps = sleeps

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        request.read()
        self.asked.append(request)
        answer = self._answers.pop(0)
        if isinstance(answer, httpx2.TransportError):
            raise answer
        return answer

    @property
    def pauses(self) -> list[float]:
        return [pause for pause in self.sleeps if pause > 0]


@pytest.fixture
def scripted(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[Client, Script]]:
    """A client of made up answers."""
    sleeps: list[float] = []
    monkeypatch.setattr("mapfit_client.wire.blocking.time.sleep", sleeps.append)

    def make(*answers: Scripted, key: str | None = None) -> tuple[Client, Script]:
        script = Script(*answers, sleeps=sleeps)
        return Client("http://somewhere", key, transport=httpx2.MockTransport(script)), script

    return make


def answer(status: int, content: Any = None, **headers: str) -> httpx2.Response:
    return httpx2.Response(status, json=content, headers={name.replace("_", "-"): v for name, v in headers.items()})


def test_a_busy_service_is_asked_again_when_it_says(scripted: Callable[..., tuple[Client, Script]]) -> None:
    """`Retry-After` in seconds or as a date; a submission keeps its key and body."""
    later = format_datetime(datetime.now(UTC) + timedelta(seconds=20), usegmt=True)
    client, script = scripted(
        answer(429, retry_after="7"), answer(503, retry_after=later), answer(503), answer(202, JOB), key="secret"
    )
    assert client.submit({"scans": [{"ranges": np.arange(9000.0)}]}).id == "j"
    assert script.pauses[0] == 7 and 17 < script.pauses[1] <= 20 and 1 <= script.pauses[2] <= 2
    keys = {request.headers["idempotency-key"] for request in script.asked}
    assert len(keys) == 1 and len({request.content for request in script.asked}) == 1
    assert script.asked[0].headers["authorization"] == "Bearer secret"
    assert script.asked[0].headers["content-encoding"] == "gzip"
    assert script.asked[0].headers["user-agent"].startswith("mapfit-client/")


def test_a_broken_connection_is_no_second_job(scripted: Callable[..., tuple[Client, Script]]) -> None:
    """A submission is repeated under its key; a cancellation, which has none, only if it never left."""
    broken = httpx2.ReadError("reset by peer")
    client, script = scripted(broken, answer(502), answer(202, JOB), httpx2.ConnectError("refused"), broken)
    job = client.submit({})
    assert len({request.headers["idempotency-key"] for request in script.asked}) == 1
    with pytest.raises(NotReachable, match="reset by peer") as failed:
        job.cancel()
    assert failed.value.problem["status"] == 0
    assert [request.method for request in script.asked] == ["POST"] * 3 + ["DELETE"] * 2


def test_patience_ends(scripted: Callable[..., tuple[Client, Script]]) -> None:
    """After six tries, with pauses that grow; what is refused is not asked again."""
    client, script = scripted(*[answer(503)] * 6)
    with pytest.raises(MapfitError, match="503"):
        client.job("j")
    assert len(script.asked) == 6 and script.pauses == sorted(script.pauses) and sum(script.pauses) < 16
    client, script = scripted(answer(404, {"title": "t", "status": 404, "detail": "d"}))
    with pytest.raises(MapfitError):
        client.job("j")
    assert len(script.asked) == 1


def test_what_is_no_problem_document_is_one_here(scripted: Callable[..., tuple[Client, Script]]) -> None:
    """A proxy's page, say."""
    client, _ = scripted(httpx2.Response(403, text="<html>No entry</html>"))
    with pytest.raises(MapfitError) as refused:
        client.job("j")
    assert refused.value.problem["status"] == 403 and "No entry" in refused.value.problem["detail"]


def test_a_service_that_stops_is_not_besieged(scripted: Callable[..., tuple[Client, Script]]) -> None:
    """Its long polls end at once; whoever waits takes a breath between them."""
    client, script = scripted(answer(200, JOB), answer(200, JOB), answer(200, JOB | {"status": "failed"}))

    assert client._connection.run(jobs.ended("j", None, None))["status"] == "failed"
    assert script.pauses == [0.5, 0.5]
    assert all(request.url.params["wait"] == "30.000" for request in script.asked)


def test_localize_says_what_the_contract_says(scripted: Callable[..., tuple[Client, Script]], signed: Map) -> None:
    """The question as it is sent, the answer as it is read: also of a scan that fits nowhere."""
    pose = {"x": 1.0, "y": 2.0, "theta": 0.1}
    found = {"pose": pose, "covariance": list(range(9)), "converged": True, "used": 170, "left_out": 3}
    more = {"chi_squared": 160.0, "degrees_of_freedom": 167, "hypotheses": [{"pose": pose, "probability": 0.9}]}
    lost = found | {"pose": None, "covariance": None, "converged": False}
    client, script = scripted(answer(200, signed.record), answer(200, {"poses": [found | more, lost]}))
    scans: list[dict[str, Any]] = [{"pose": None, "ranges": np.array([1.0, np.nan])}, {"pose": pose, "ranges": [2.0]}]
    first, second = client.map(signed.id).localize(scans, noise={"sigma_range": 0.02}, hypotheses=2)
    asked = json.loads(script.asked[1].content)
    assert script.asked[1].url.path == f"/v1/maps/{signed.id}/localize"
    assert asked["scans"] == [{"pose": None, "ranges": [1.0, None]}, {"pose": pose, "ranges": [2.0]}]
    assert set(asked) == {"scans", "noise", "hypotheses"}
    assert first.pose == pose and first.covariance is not None and first.covariance[1, 2] == 5
    assert first.hypotheses[0]["probability"] == 0.9 and (first.used, first.left_out) == (170, 3)
    assert second.pose is None and second.covariance is None and not second.converged


def test_places_follow_the_contract(scripted: Callable[..., tuple[Client, Script]], signed: Map) -> None:
    """Read, published, rolled back, listed; names are quoted."""
    lab = {"name": "lab", "version": 1, "map_id": signed.id, "published": "2026-11-26T00:00:00Z"}
    client, script = scripted(
        answer(200, lab),
        answer(200, signed.record),
        answer(200, lab | {"version": 2}),
        answer(200, lab | {"version": 3}),
        answer(200, {"items": [lab], "next_cursor": None}),
        answer(404),
    )
    place = client.place("lab")
    assert place.map().id == signed.id and "version 1" in repr(place)
    assert place.publish("m", "monday").version == 2 and place.rollback(1).version == 3
    assert [listed.name for listed in client.places()] == ["lab"]
    with pytest.raises(MapfitError):
        client.place("../maps")
    assert [(request.method, request.url.raw_path.decode()) for request in script.asked] == [
        ("GET", "/v1/places/lab"),
        ("GET", f"/v1/maps/{signed.id}"),
        ("PUT", "/v1/places/lab"),
        ("POST", "/v1/places/lab/rollback"),
        ("GET", "/v1/places?limit=100"),
        ("GET", "/v1/places/..%2Fmaps"),
    ]
    assert json.loads(script.asked[2].content) == {"map_id": "m", "note": "monday"}


def test_nobody_there() -> None:
    """An address without a service."""
    with Client("127.0.0.1:9", tries=1) as client, pytest.raises(NotReachable):
        client.job("j")


def test_awaiting_is_as_patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """The awaiting transport makes of an answer what the blocking one does."""
    sleeps: list[float] = []

    async def sleep(pause: float) -> None:
        sleeps.append(pause)

    monkeypatch.setattr("mapfit_client.wire.awaiting.asyncio.sleep", sleep)
    script = Script(
        answer(429, retry_after="3"), httpx2.ReadError("reset"), answer(202, JOB), answer(409), sleeps=sleeps
    )

    async def go() -> None:
        async with AsyncClient("http://somewhere", transport=httpx2.MockTransport(script)) as client:
            job = await client.submit({})
            assert job.id == "j"
            with pytest.raises(MapfitError, match="409"):
                await job.cancel()

    asyncio.run(go())
    assert script.pauses[0] == 3 and len(script.asked) == 4
