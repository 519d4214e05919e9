"""Jobs: submission, state, waiting, cancellation."""

import gzip
import json
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ..recordings.jobs import plain
from ..records import ENDED, JobRecord
from ..wire.exchange import Ask, Exchange, address, get_json

Show = Callable[[JobRecord], None]
"""Told about a job whenever something is heard of it."""

_WORTH_PACKING = 16_384
_PATIENT = 12
"""Tries of whoever waits: a service that is restarted is back within some minutes."""


def submit(job: Mapping[str, Any], idempotency_key: str | None, path: str = "/v1/jobs") -> Exchange[JobRecord]:
    """Submits a job once, however often the request has to be sent: a key is made where none is given."""
    headers = {"content-type": "application/json", "idempotency-key": idempotency_key or str(uuid.uuid4())}
    body = json.dumps(job, allow_nan=False, separators=(",", ":")).encode()
    if len(body) >= _WORTH_PACKING:
        body, headers["content-encoding"] = gzip.compress(body, 1, mtime=0), "gzip"
    answer = yield Ask("POST", path, headers=headers, body=body)
    record: JobRecord = answer.json()
    return record


def update(map_id: str, job: Mapping[str, Any], idempotency_key: str | None) -> Exchange[JobRecord]:
    """Submits new scans for a map; a job's `map` is left out, since the map's own counts."""
    new = {name: member for name, member in job.items() if name != "map"}
    return submit(new, idempotency_key, address("maps", map_id, "updates"))


def join(
    maps: Sequence[Mapping[str, Any]], resolution: float, further: Mapping[str, Any], idempotency_key: str | None
) -> Exchange[JobRecord]:
    """Submits a join; further members that are None are left out."""
    known = {name: plain(member) for name, member in further.items() if member is not None}
    body = {"maps": plain(maps), "map": {"resolution": float(resolution)}, **known}
    return submit(body, idempotency_key, "/v1/joins")


def get(job_id: str) -> Exchange[JobRecord]:
    """A job as it is now."""
    record: JobRecord = yield from get_json(address("jobs", job_id))
    return record


def request(job_id: str) -> Exchange[dict[str, Any]]:
    """The request as it was accepted."""
    accepted: dict[str, Any] = yield from get_json(address("jobs", job_id, "request"))
    return accepted


def cancel(job_id: str) -> Exchange[JobRecord]:
    """Cancels a job that has not ended."""
    answer = yield Ask("DELETE", address("jobs", job_id), repeatable=False)
    record: JobRecord = answer.json()
    return record


def ended(job_id: str, show: Show | None, timeout: float | None) -> Exchange[JobRecord]:
    """The job once it has ended, by long polls: short ones where somebody looks on.

    A service that is about to stop answers at once; it is then left alone for a moment.
    """
    wait = 30.0 if show is None else 1.0
    begun = time.monotonic()
    after = 0.0
    while True:
        asked = time.monotonic()
        left = wait if timeout is None else min(wait, max(timeout - (asked - begun), 0.0))
        params = {"wait": f"{left:.3f}"}
        answer = yield Ask("GET", address("jobs", job_id), params=params, tries=_PATIENT, after=after)
        record: JobRecord = answer.json()
        if show is not None:
            show(record)
        if record["status"] in ENDED:
            return record
        now = time.monotonic()
        if timeout is not None and now - begun >= timeout:
            raise TimeoutError(f"job {job_id} has not ended within {timeout:g} s; it goes on")
        after = 0.5 if now - asked < 0.5 * left else 0.0
