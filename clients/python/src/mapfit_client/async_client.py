"""`AsyncClient`: a service, awaited."""

from collections.abc import AsyncIterator, Mapping, Sequence
from os import PathLike
from types import TracebackType
from typing import Any

import httpx2

from .async_jobs import AsyncJob
from .async_maps import AsyncMap
from .places import AsyncPlace
from .recordings.jobs import as_job
from .records import JobStatus
from .routes import jobs, maps, pages, places
from .wire.awaiting import AsyncConnection
from .wire.retries import Retries
from .wire.settings import settings


class AsyncClient:
    """A mapfit service, as `Client`; what asks it is awaited. Use it in an `async with` statement, or `close` it."""

    def __init__(
        self,
        url: str = "http://127.0.0.1:8080",
        key: str | None = None,
        *,
        timeout: float | None = None,
        tries: int = 6,
        transport: httpx2.AsyncBaseTransport | None = None,
    ) -> None:
        self._connection = AsyncConnection(settings(url, key, timeout), Retries(tries), transport)

    async def __aenter__(self) -> "AsyncClient":
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Closes the connections."""
        await self._connection.close()

    async def submit(
        self, job: Mapping[str, Any] | str | PathLike[str], *, idempotency_key: str | None = None
    ) -> AsyncJob:
        """Submits a job: a document, a job file (.json) or a CARMEN log, gzipped or not.

        Whatever breaks on the way, one job comes of it; with a key of yours, of all calls with it.
        """
        return AsyncJob(await self._connection.run(jobs.submit(as_job(job), idempotency_key)), self._connection)

    async def join(
        self,
        maps: Sequence[Mapping[str, Any]],
        resolution: float,
        *,
        name: str | None = None,
        labels: Mapping[str, str] | None = None,
        fit: Mapping[str, Any] | None = None,
        idempotency_key: str | None = None,
    ) -> AsyncJob:
        """Submits a join of maps, each `{"id": ..., "pose": ..., "pose_covariance": ...}` with a guess at its frame.

        The first map's frame is held; the joined map's `frames` tell where the others were found to lie.
        """
        further = {"name": name, "labels": labels, "fit": fit}
        return AsyncJob(
            await self._connection.run(jobs.join(maps, resolution, further, idempotency_key)), self._connection
        )

    async def job(self, id: str) -> AsyncJob:
        """A job by its id."""
        return AsyncJob(await self._connection.run(jobs.get(id)), self._connection)

    async def map(self, id: str) -> AsyncMap:
        """A map by its id, downloaded, so that it evaluates without being awaited."""
        return await AsyncMap(await self._connection.run(maps.get(id)), self._connection).download()

    async def place(self, name: str) -> AsyncPlace:
        """A place by its name."""
        return AsyncPlace(await self._connection.run(places.get(name)), self._connection)

    async def publish(self, name: str, map_id: str, note: str | None = None) -> AsyncPlace:
        """Publishes a map at a place, which need not be there yet."""
        return AsyncPlace(await self._connection.run(places.publish(name, map_id, note)), self._connection)

    async def jobs(
        self, *, status: JobStatus | None = None, labels: Mapping[str, str] | None = None, page_size: int = 100
    ) -> AsyncIterator[AsyncJob]:
        """All jobs, newest first; those in a state, or with all of these labels."""
        async for record in self._records("/v1/jobs", pages.selection(labels, page_size, status=status)):
            yield AsyncJob(record, self._connection)

    async def maps(
        self,
        *,
        labels: Mapping[str, str] | None = None,
        bbox: Sequence[float] | None = None,
        page_size: int = 100,
    ) -> AsyncIterator[AsyncMap]:
        """All maps, newest first, not downloaded; those with all of these labels, or that touch a rectangle."""
        async for record in self._records("/v1/maps", pages.selection(labels, page_size, bbox=pages.box(bbox))):
            yield AsyncMap(record, self._connection)

    async def places(self, *, page_size: int = 100) -> AsyncIterator[AsyncPlace]:
        """All places."""
        async for record in self._records("/v1/places", pages.selection(None, page_size)):
            yield AsyncPlace(record, self._connection)

    async def _records(self, path: str, chosen: pages.Params) -> AsyncIterator[Any]:
        cursor: str | None = None
        while True:
            page = await self._connection.run(pages.page(path, chosen, cursor))
            for record in page.items:
                yield record
            cursor = page.next_cursor
            if cursor is None:
                return
