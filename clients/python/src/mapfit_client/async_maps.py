"""`AsyncMap`: a fitted map whose service is awaited."""

import asyncio
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, TypeVar

from .evaluation import Evaluation
from .fitted import Arrays, FittedMap
from .localization import LocalizedPose
from .occupancy import OccupancyGrid
from .recordings.jobs import as_job
from .records import Kind, MapRecord, PosedScan
from .routes import jobs, maps
from .wire.awaiting import AsyncConnection
from .wire.exchange import Exchange

if TYPE_CHECKING:
    from .async_jobs import AsyncJob

T = TypeVar("T")


class AsyncMap(FittedMap):
    """A fitted map. Its arrays are here once `download` was awaited, as `client.map` and `job.wait` do."""

    def __init__(self, record: MapRecord, connection: AsyncConnection) -> None:
        super().__init__(record)
        self._connection = connection

    async def download(self) -> "AsyncMap":
        """Downloads what is not here yet, all at a time, and gives the map back."""
        missing = [name for name in maps.PARTS if name not in self._parts]
        got = await asyncio.gather(*(self._run(maps.part(self.id, name)) for name in missing))
        self._parts |= dict(zip(missing, got, strict=True))
        return self

    async def query(self, points: Any, kind: Kind = "propagated") -> Evaluation:
        """What the service says about points (..., 2)."""
        return await self._run(maps.query(self.id, self.distance, points, kind))

    async def contours(
        self, level: float = 0.0, *, sigma_band: float | None = None, kind: Kind = "propagated"
    ) -> dict[str, Any]:
        """A level line of the distance as GeoJSON in metres, with the region it lies in to so many sigma."""
        return await self._run(maps.contours(self.id, level, sigma_band, kind))

    async def ogm(self, resolution: float | None = None, *, kind: Kind = "propagated") -> OccupancyGrid:
        """The occupancy grid map; its cells are the lattice's by default."""
        return await self._run(maps.ogm(self.id, resolution, kind))

    async def grid(
        self,
        layers: Sequence[str] = ("distance", "sigma", "clearance"),
        *,
        resolution: float | None = None,
        kind: Kind = "propagated",
    ) -> Arrays:
        """Rasters for planners by the layers' names, the lowest y first, with `origin` and `resolution`."""
        return await self._run(maps.grid(self.id, layers, resolution, kind))

    async def poses(self) -> list[PosedScan]:
        """The scans' poses as the fit has them."""
        return await self._run(maps.poses(self.id))

    async def update(
        self, job: Mapping[str, Any] | str | PathLike[str], *, idempotency_key: str | None = None
    ) -> "AsyncJob":
        """Submits new scans, as `Client.submit` takes them: a job whose map knows what one fit of all scans would.

        This map stays as it is.
        """
        from .async_jobs import AsyncJob  # noqa: PLC0415  (a job gives maps, and a map jobs)

        record = await self._run(jobs.update(self.id, as_job(job), idempotency_key))
        return AsyncJob(record, self._connection)

    async def changes(self, since: "AsyncMap | str", *, probability: float = 0.99) -> dict[str, Any]:
        """What differs from another map beyond what the uncertainty of both explains, as GeoJSON in metres."""
        return await self._run(maps.changes(self.id, since if isinstance(since, str) else since.id, probability))

    async def frames(self) -> list[dict[str, Any]]:
        """Where the frames of the maps that were joined to this one lie: `map_id`, `pose`, `covariance`."""
        return await self._run(maps.frames(self.id))

    async def localize(
        self,
        scans: Sequence[Mapping[str, Any]],
        *,
        noise: Mapping[str, float] | None = None,
        kind: Kind | None = None,
        motions: Sequence[Mapping[str, Any]] | None = None,
        hypotheses: int | None = None,
    ) -> list[LocalizedPose]:
        """Where scans were taken; a scan's pose is the prior, None for anywhere."""
        question = {"scans": scans, "noise": noise, "kind": kind, "motions": motions, "hypotheses": hypotheses}
        return await self._run(maps.localize(self.id, question))

    async def delete(self) -> None:
        """Deletes the map and its arrays at the service."""
        await self._run(maps.delete(self.id))

    _cure = "await map.download() first"

    async def _run(self, exchange: Exchange[T]) -> T:
        return await self._connection.run(exchange)
