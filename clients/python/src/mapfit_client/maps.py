"""`Map`: a fitted map whose service is asked in place."""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, TypeVar

from . import archive
from .evaluation import Evaluation
from .fitted import Arrays, FittedMap
from .localization import LocalizedPose
from .occupancy import OccupancyGrid
from .records import Kind, MapRecord, PosedScan
from .routes import maps
from .wire.blocking import Connection
from .wire.exchange import Exchange

T = TypeVar("T")


class Map(FittedMap):
    """A fitted map. Its arrays are downloaded when they are first needed, and kept."""

    def __init__(
        self, record: MapRecord, connection: Connection | None = None, parts: archive.Parts | None = None
    ) -> None:
        super().__init__(record, parts)
        self._connection = connection

    @classmethod
    def load(cls, path: str | PathLike[str]) -> "Map":
        """A map that `save` wrote: all but asking the service works."""
        record, parts = archive.read(path)
        return cls(record, parts=parts)

    def download(self) -> "Map":
        """Downloads what is not here yet, and gives the map back."""
        for name in maps.PARTS:
            self._part(name)
        return self

    def query(self, points: Any, kind: Kind = "propagated") -> Evaluation:
        """What the service says about points (..., 2)."""
        return self._run(maps.query(self.id, self.distance, points, kind))

    def contours(
        self, level: float = 0.0, *, sigma_band: float | None = None, kind: Kind = "propagated"
    ) -> dict[str, Any]:
        """A level line of the distance as GeoJSON in metres, with the region it lies in to so many sigma."""
        return self._run(maps.contours(self.id, level, sigma_band, kind))

    def ogm(self, resolution: float | None = None, *, kind: Kind = "propagated") -> OccupancyGrid:
        """The occupancy grid map; its cells are the lattice's by default."""
        return self._run(maps.ogm(self.id, resolution, kind))

    def grid(
        self,
        layers: Sequence[str] = ("distance", "sigma", "clearance"),
        *,
        resolution: float | None = None,
        kind: Kind = "propagated",
    ) -> Arrays:
        """Rasters for planners by the layers' names, the lowest y first, with `origin` and `resolution`."""
        return self._run(maps.grid(self.id, layers, resolution, kind))

    def poses(self) -> list[PosedScan]:
        """The scans' poses as the fit has them."""
        return self._run(maps.poses(self.id))

    def localize(
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
        return self._run(maps.localize(self.id, question))

    def delete(self) -> None:
        """Deletes the map and its arrays at the service."""
        self._run(maps.delete(self.id))

    def _fetch(self, name: maps.Part) -> Arrays:
        return super()._fetch(name) if self._connection is None else self._run(maps.part(self.id, name))

    def _run(self, exchange: Exchange[T]) -> T:
        if self._connection is None:
            raise RuntimeError(f"map {self.id} was loaded from a file; client.map({self.id!r}) can ask the service")
        return self._connection.run(exchange)
