"""`Job`: a submitted job, followed by waiting in place."""

from typing import Any

from .errors import JobFailed
from .maps import Map
from .progress import Progress, looking_on
from .records import JobRecord
from .routes import jobs, maps
from .submitted import SubmittedJob
from .wire.blocking import Connection


class Job(SubmittedJob):
    """A submitted job."""

    def __init__(self, record: JobRecord, connection: Connection) -> None:
        super().__init__(record)
        self._connection = connection

    def refresh(self) -> "Job":
        """Asks how the job is, and gives it back."""
        self.record = self._connection.run(jobs.get(self.id))
        return self

    def wait(self, progress: Progress = True, timeout: float | None = None) -> Map:
        """Waits until the job has ended and gives its map.

        `progress` draws a bar, or is told of every change. Raises `JobFailed` where there is no map, and
        `TimeoutError` after so many seconds; the job then goes on.
        """
        with looking_on(progress, self.record) as show:
            self.record = self._connection.run(jobs.ended(self.id, show, timeout))
        return self.map()

    def map(self) -> Map:
        """The map of a job that has ended."""
        if not self.ended:
            self.refresh()
        if self.record["map_id"] is None:
            raise JobFailed(self.record)
        return Map(self._connection.run(maps.get(self.record["map_id"])), self._connection)

    def request(self) -> dict[str, Any]:
        """The request as it was accepted."""
        return self._connection.run(jobs.request(self.id))

    def cancel(self) -> "Job":
        """Cancels the job, which must not have ended, and gives it back."""
        self.record = self._connection.run(jobs.cancel(self.id))
        return self
