"""`Client`: a service, asked in place."""

from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from types import TracebackType
from typing import Any

import httpx2

from .jobs import Job
from .maps import Map
from .places import Place
from .recordings.jobs import as_job
from .records import JobStatus
from .routes import jobs, maps, pages, places
from .wire.blocking import Connection
from .wire.retries import Retries
from .wire.settings import settings


class Client:
    """A mapfit service. Use it in a `with` statement, or `close` it.

    `timeout` is seconds without a sign of life, `tries` how often something is asked while the service is busy or
    cannot be reached; `transport` is httpx2's, for proxies and tests.
    """

    def __init__(
        self,
        url: str = "http://127.0.0.1:8080",
        key: str | None = None,
        *,
        timeout: float | None = None,
        tries: int = 6,
        transport: httpx2.BaseTransport | None = None,
    ) -> None:
        self._connection = Connection(settings(url, key, timeout), Retries(tries), transport)

    def __enter__(self) -> "Client":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connections."""
        self._connection.close()

    def submit(self, job: Mapping[str, Any] | str | PathLike[str], *, idempotency_key: str | None = None) -> Job:
        """Submits a job: a document, a job file (.json) or a CARMEN log, gzipped or not.

        Whatever breaks on the way, one job comes of it; with a key of yours, of all calls with it.
        """
        return Job(self._connection.run(jobs.submit(as_job(job), idempotency_key)), self._connection)

    def join(
        self,
        maps: Sequence[Mapping[str, Any]],
        resolution: float,
        *,
        name: str | None = None,
        labels: Mapping[str, str] | None = None,
        fit: Mapping[str, Any] | None = None,
        idempotency_key: str | None = None,
    ) -> Job:
        """Submits a join of maps, each `{"id": ..., "pose": ..., "pose_covariance": ...}` with a guess at its frame.

        The first map's frame is held; the joined map's `frames` tell where the others were found to lie.
        """
        further = {"name": name, "labels": labels, "fit": fit}
        return Job(self._connection.run(jobs.join(maps, resolution, further, idempotency_key)), self._connection)

    def job(self, id: str) -> Job:
        """A job by its id."""
        return Job(self._connection.run(jobs.get(id)), self._connection)

    def map(self, id: str) -> Map:
        """A map by its id."""
        return Map(self._connection.run(maps.get(id)), self._connection)

    def place(self, name: str) -> Place:
        """A place by its name."""
        return Place(self._connection.run(places.get(name)), self._connection)

    def publish(self, name: str, map_id: str, note: str | None = None) -> Place:
        """Publishes a map at a place, which need not be there yet."""
        return Place(self._connection.run(places.publish(name, map_id, note)), self._connection)

    def jobs(
        self, *, status: JobStatus | None = None, labels: Mapping[str, str] | None = None, page_size: int = 100
    ) -> Iterator[Job]:
        """All jobs, newest first; those in a state, or with all of these labels."""
        chosen = pages.selection(labels, page_size, status=status)
        return (Job(record, self._connection) for record in self._records("/v1/jobs", chosen))

    def maps(
        self,
        *,
        labels: Mapping[str, str] | None = None,
        bbox: Sequence[float] | None = None,
        page_size: int = 100,
    ) -> Iterator[Map]:
        """All maps, newest first; those with all of these labels, or that touch (min x, min y, max x, max y)."""
        chosen = pages.selection(labels, page_size, bbox=pages.box(bbox))
        return (Map(record, self._connection) for record in self._records("/v1/maps", chosen))

    def places(self, *, page_size: int = 100) -> Iterator[Place]:
        """All places."""
        chosen = pages.selection(None, page_size)
        return (Place(record, self._connection) for record in self._records("/v1/places", chosen))

    def _records(self, path: str, chosen: pages.Params) -> Iterator[Any]:
        cursor: str | None = None
        while True:
            page = self._connection.run(pages.page(path, chosen, cursor))
            yield from page.items
            cursor = page.next_cursor
            if cursor is None:
                return
