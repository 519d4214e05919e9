"""A fitted map, on this side of the wire: its record, its arrays, and what can be said without the service.

A map is made of four parts (`routes.maps.PARTS`), downloaded once each. How they get here is what tells maps apart:
`Map` fetches a part when it is first needed, `AsyncMap` has them all before it is handed out.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from . import archive
from .chart import Chart
from .errors import NotDownloaded
from .evaluation import Evaluation
from .records import KINDS, Distance, FitRecord, Kind, MapRecord
from .routes.maps import PARTS, Part
from .spline.lattice import Floats, Lattice
from .spline.stencil import Stencil
from .surfaces.evidence import Evidence
from .surfaces.facets import Facets

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Arrays = dict[str, NDArray[Any]]


class FittedMap:
    """What every map has, wherever it came from."""

    def __init__(self, record: MapRecord, parts: archive.Parts | None = None) -> None:
        self.record = record
        self._parts: archive.Parts = dict(parts or {})
        self._stencils: dict[Kind, list[Stencil]] = {}

    def __repr__(self) -> str:
        nx, ny = self.lattice.cells
        named = f" {self.name!r}" if self.name else ""
        size = f"{nx} x {ny} cells of {self.lattice.resolution} m"
        return f"<{type(self).__name__} {self.id}{named}: {self.distance}, {size}>"

    @property
    def id(self) -> str:
        """The map's id."""
        return self.record["id"]

    @property
    def name(self) -> str | None:
        """Its job's name."""
        return self.record["name"]

    @property
    def labels(self) -> dict[str, str]:
        """Its labels."""
        return self.record["labels"]

    @property
    def distance(self) -> Distance:
        """Which distance it holds: `sdf`, negative in free space, or `vdf`."""
        return self.record["distance"]

    @property
    def fit(self) -> FitRecord:
        """What the fit reports about itself: whether it converged, for one."""
        return self.record["fit"]

    @cached_property
    def lattice(self) -> Lattice:
        """Where its cells lie."""
        return Lattice.of(self.record["lattice"])

    @cached_property
    def coefficients(self) -> dict[str, Floats]:
        """`sdf`, or `vdf_x` and `vdf_y`, each (ny+3, nx+3), metres; NaN where a control point is not in use."""
        names = ("sdf",) if self.distance == "sdf" else ("vdf_x", "vdf_y")
        arrays = self._part("coefficients")
        return {name: arrays[name] for name in names}

    @cached_property
    def covariance(self) -> Mapping[Kind, "sp.csc_array[np.float64]"]:
        """By kind the coefficients' covariance, square metres: every entry between control points that share a cell.

        Ordered as the coefficients are, x fastest; a vector map has the x set before the y set.
        """
        return _Covariances(self._part)

    @cached_property
    def facets(self) -> Facets:
        """The surfaces, as short straight pieces."""
        arrays = self._part("surfaces")
        return Facets(arrays["ends"], arrays["sigma"], arrays["open"].astype(bool), self.lattice.resolution).whole()

    @cached_property
    def evidence(self) -> Evidence:
        """Where there is evidence."""
        return Evidence(self.lattice, self._part("surfaces")["observed"] != 0)

    def evaluate(self, points: Any, kind: Kind = "propagated") -> Evaluation:
        """Distance, sigma and the rest at points (..., 2): computed here, what `query` would answer."""
        if kind not in KINDS:
            raise ValueError(f"kind is one of {', '.join(KINDS)}, not {kind!r}")
        if kind not in self._stencils:
            self._stencils[kind] = self._chart.stencils(self.covariance[kind])
        return self._chart.evaluate(points, kind, self._stencils[kind])

    def save(self, path: str | PathLike[str]) -> None:
        """Writes the whole map to one npz file, from which `Map.load` evaluates without a service."""
        archive.write(path, self.record, {name: self._part(name) for name in PARTS})

    def plot(
        self,
        layer: str = "distance",
        *,
        ax: "Axes | None" = None,
        kind: Kind = "propagated",
        resolution: float | None = None,
        surfaces: bool = True,
    ) -> "Axes":
        """Draws `distance`, `sigma` or `clearance` with the surfaces on matplotlib axes, new ones by default."""
        from .plot import draw  # noqa: PLC0415 - matplotlib is an extra

        return draw(self, layer, ax, kind, resolution, surfaces)

    @cached_property
    def _chart(self) -> Chart:
        return Chart(self.lattice, list(self.coefficients.values()), self.facets, self.evidence)

    def _part(self, name: Part) -> Arrays:
        """A part's arrays, which are here or can be had."""
        if name not in self._parts:
            self._parts[name] = self._fetch(name)
        return self._parts[name]

    def _fetch(self, name: Part) -> Arrays:
        raise NotDownloaded(
            {
                "type": "/problems/not-downloaded",
                "title": "Not downloaded",
                "status": 0,
                "detail": f"the {name} of map {self.id} are not here: {self._cure}",
            }
        )

    _cure = "the map was not made by a client"


class _Covariances(Mapping[Kind, "sp.csc_array[np.float64]"]):
    """The two covariances, each put together when it is first asked for."""

    def __init__(self, part: Callable[[Part], Arrays]) -> None:
        self._part = part
        self._known: dict[Kind, sp.csc_array[np.float64]] = {}

    def __getitem__(self, kind: Kind) -> "sp.csc_array[np.float64]":
        if kind not in KINDS:
            raise KeyError(kind)
        if kind not in self._known:
            a = self._part(kind)
            self._known[kind] = sp.csc_array((a["data"], a["indices"], a["indptr"]), shape=tuple(a["shape"].tolist()))
        return self._known[kind]

    def __iter__(self) -> Iterator[Kind]:
        return iter(KINDS)

    def __len__(self) -> int:
        return len(KINDS)
