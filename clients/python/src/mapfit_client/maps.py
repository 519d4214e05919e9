"""`Map`: a fitted map whose service is asked in place."""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, TypeVar

from . import archive
from .evaluation import Evaluation
from .fitted import Arrays, FittedMap
from .localization import LocalizedPose
from .occupancy import OccupancyGrid
from .recordings.jobs import as_job
from .records import Kind, MapRecord, PosedScan
from .routes import jobs, maps
from .wire.blocking import Connection
from .wire.exchange import Exchange

if TYPE_CHECKING:
    from .jobs import Job

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

    def update(self, job: Mapping[str, Any] | str | PathLike[str], *, idempotency_key: str | None = None) -> "Job":
        """Submits new scans, as `Client.submit` takes them: a job whose map knows what one fit of all scans would.

        This map stays as it is.
        """
        from .jobs import Job  # noqa: PLC0415  (a job gives maps, and a map jobs)

        if self._connection is None:
            raise RuntimeError(f"map {self.id} was loaded from a file; client.map({self.id!r}) can ask the service")
        record = self._run(jobs.update(self.id, as_job(job), idempotency_key))
        return Job(record, self._connection)

    def changes(self, since: "Map | str", *, probability: float = 0.99) -> dict[str, Any]:
        """What differs from another map beyond what the uncertainty of both explains, as GeoJSON in metres."""
        return self._run(maps.changes(self.id, since if isinstance(since, str) else since.id, probability))

    def frames(self) -> list[dict[str, Any]]:
        """Where the frames of the maps that were joined to this one lie: `map_id`, `pose`, `covariance`."""
        return self._run(maps.frames(self.id))

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
