"""`AsyncMap`: a fitted map whose service is awaited."""

import asyncio
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from .evaluation import Evaluation
from .fitted import Arrays, FittedMap
from .localization import LocalizedPose
from .occupancy import OccupancyGrid
from .records import Kind, MapRecord, PosedScan
from .routes import maps
from .wire.awaiting import AsyncConnection
from .wire.exchange import Exchange

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
