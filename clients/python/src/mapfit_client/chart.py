"""A map's arrays put together: what answers for points, here, as the service would.

A signed map's distance is its spline's, row . c, with the variance row^T C row. A vector map's is that to its surfaces
(`surfaces.facets`); its spline's value is the vector. Either way clearance is the distance to the nearest surface or to
unobserved space. Points are taken some thousands at a time.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .evaluation import Evaluation, as_points
from .records import Distance, Kind
from .spline.basis import Rows, rows
from .spline.lattice import Floats, Integers, Lattice
from .spline.stencil import Stencil, stencils
from .surfaces.evidence import Evidence
from .surfaces.facets import Facets, Feet
from .surfaces.nearest import Nearest

_POINTS_AT_ONCE = 8192


class Chart:
    """A lattice, the coefficients of one or two components (NaN where one is not in use), facets and evidence."""

    def __init__(self, lattice: Lattice, components: list[Floats], facets: Facets, evidence: Evidence) -> None:
        self.lattice = lattice
        self._components = [np.ravel(c) for c in components]
        self._in_use = np.isfinite(self._components[0])
        self._nearest = Nearest(facets) if len(facets) else None
        self._evidence = evidence

    def stencils(self, covariance: "sp.csc_array[np.float64]") -> list[Stencil]:
        """The coefficients' covariance, ready for `evaluate`."""
        return stencils(covariance, self.lattice.cells[0] + 3, len(self._components))

    def evaluate(self, points: Any, kind: Kind, covariance: list[Stencil]) -> Evaluation:
        """What the map says about points (..., 2)."""
        flat, shape = as_points(points)
        starts = range(0, len(flat), _POINTS_AT_ONCE)
        parts = [self._answers(flat[start : start + _POINTS_AT_ONCE], kind, covariance) for start in starts]
        distance: Distance = "sdf" if len(self._components) == 1 else "vdf"
        return Evaluation.joined(kind, distance, parts).shaped(shape)

    def _answers(self, points: Floats, kind: Kind, covariance: list[Stencil]) -> Mapping[str, NDArray[Any]]:
        at = self.lattice.locate(points)
        observed = self._evidence.at(at)
        support = self.lattice.support(at.cell)
        # The spline is where all of a cell's control points are in use.
        on_spline = at.inside & self._in_use[support].all(axis=1)
        feet = self._feet(points, np.flatnonzero(observed | on_spline), kind)
        answers = {
            "nearest": np.where(on_spline[:, None], feet.point, np.nan),
            "clearance": np.fmin(self._evidence.to_unseen(points, at), feet.distance),
            "observed": observed,
        }
        vector_map = len(self._components) == 2
        # A vector map's answers are about its surfaces: one without any has none.
        which = np.flatnonzero(on_spline & (not vector_map or self._nearest is not None))
        row, first = rows(at.local[which], self.lattice.resolution), support[which, 0]
        coefficients = [c[support[which]] for c in self._components]
        if vector_map:
            foot = {"distance": feet.distance[which], "sigma": feet.sigma[which], "gradient": feet.away[which]}
            known = foot | _vector(row, coefficients, covariance, first)
        else:
            known = _signed(row, coefficients[0], covariance[0], first)
        return answers | _spread(len(points), which, known)

    def _feet(self, points: Floats, which: Integers, kind: Kind) -> Feet:
        """The feet of some of the points; NaN for the others, and where the map has no surface."""
        n = len(points)
        feet = Feet(np.full((n, 2), np.nan), np.full(n, np.nan), np.full(n, np.nan), np.full((n, 2), np.nan))
        if self._nearest is not None and len(which):
            own = self._nearest.feet(points[which], kind, rivals=len(self._components) == 2)
            for whole, part in zip(feet, own, strict=True):
                whole[which] = part
        return feet


def _signed(row: Rows, coefficients: Floats, covariance: Stencil, first: Integers) -> dict[str, Floats]:
    with np.errstate(invalid="ignore"):
        sigma = np.sqrt(covariance.form(first, row.value))
    gradient = np.stack([_dot(row.dx, coefficients), _dot(row.dy, coefficients)], axis=-1)
    return {"distance": _dot(row.value, coefficients), "sigma": sigma, "gradient": gradient}


def _vector(row: Rows, coefficients: list[Floats], covariance: list[Stencil], first: Integers) -> dict[str, Floats]:
    vector = np.stack([_dot(row.value, c) for c in coefficients], axis=-1)
    forms = np.stack([part.form(first, row.value) for part in covariance], axis=-1)
    return {"vector": vector, "vector_covariance": forms}


def _dot(row: Floats, coefficients: Floats) -> Floats:
    product: Floats = np.einsum("nk,nk->n", row, coefficients)
    return product


def _spread(n: int, which: Integers, arrays: dict[str, Floats]) -> dict[str, Floats]:
    """Arrays of some points as arrays of all, NaN elsewhere."""
    whole = {name: np.full((n, *values.shape[1:]), np.nan) for name, values in arrays.items()}
    for name, values in arrays.items():
        whole[name][which] = values
    return whole
