"""`AsyncJob`: a submitted job, awaited."""

from typing import Any

from .async_maps import AsyncMap
from .errors import JobFailed
from .progress import Progress, looking_on
from .records import JobRecord
from .routes import jobs, maps
from .submitted import SubmittedJob
from .wire.awaiting import AsyncConnection


class AsyncJob(SubmittedJob):
    """A submitted job."""

    def __init__(self, record: JobRecord, connection: AsyncConnection) -> None:
        super().__init__(record)
        self._connection = connection

    async def refresh(self) -> "AsyncJob":
        """Asks how the job is, and gives it back."""
        self.record = await self._connection.run(jobs.get(self.id))
        return self

    async def wait(self, progress: Progress = True, timeout: float | None = None) -> AsyncMap:
        """Waits until the job has ended and gives its map.

        `progress` draws a bar, or is told of every change. Raises `JobFailed` where there is no map, and
        `TimeoutError` after so many seconds; the job then goes on.
        """
        with looking_on(progress, self.record) as show:
            self.record = await self._connection.run(jobs.ended(self.id, show, timeout))
        return await self.map()

    async def map(self) -> AsyncMap:
        """The map of a job that has ended."""
        if not self.ended:
            await self.refresh()
        if self.record["map_id"] is None:
            raise JobFailed(self.record)
        return await AsyncMap(await self._connection.run(maps.get(self.record["map_id"])), self._connection).download()

    async def request(self) -> dict[str, Any]:
        """The request as it was accepted."""
        return await self._connection.run(jobs.request(self.id))

    async def cancel(self) -> "AsyncJob":
        """Cancels the job, which must not have ended, and gives it back."""
        self.record = await self._connection.run(jobs.cancel(self.id))
        return self
