"""Where there is evidence, and how far it is to space that nobody observed.

Evidence is a raster of marks, several to a cell's side. Of the marks that nothing is known of, those that border on one
of which something is are the border of the unobserved; beyond the lattice nothing is known.
"""

from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from ..spline.lattice import Floats, Lattice, Located, Marks
from .facets import norm


class Evidence:
    """Marks (rows, columns), the lowest y first: whether a beam passed there, or a surface was met."""

    def __init__(self, lattice: Lattice, observed: Marks) -> None:
        self.lattice = lattice
        self.observed = observed
        self._per_cell = observed.shape[0] // lattice.cells[1]

    def at(self, at: Located) -> Marks:
        """Whether anything is known of points; False outside the lattice."""
        sub = np.minimum((at.local * self._per_cell).astype(np.int64), self._per_cell - 1)
        column, row = (at.cell * self._per_cell + sub).T
        seen: Marks = self.observed[row, column] & at.inside
        return seen

    def to_unseen(self, points: Floats, at: Located) -> Floats:
        """Metres to the nearest unobserved place; 0 where a point is one itself, NaN outside the lattice."""
        x, y, far_x, far_y = self.lattice.bounds
        with np.errstate(invalid="ignore"):
            edge = np.min([points[:, 0] - x, far_x - points[:, 0], points[:, 1] - y, far_y - points[:, 1]], axis=0)
        nearest = edge
        inside = np.flatnonzero(at.inside)
        if self._border is not None and len(inside):
            nearest = edge.copy()
            nearest[inside] = np.minimum(edge[inside], self._to_border(points[inside]))
        return np.where(at.inside, np.where(self.at(at), nearest, 0.0), np.nan)

    def _to_border(self, points: Floats) -> Floats:
        """Metres to the nearest square of the border. Its centre need not be the nearest one."""
        assert self._border is not None
        _, mark = self._border.query(points, workers=-1)
        half = 0.5 * self.lattice.resolution / self._per_cell
        first = norm(np.maximum(np.abs(points - self._border.data[mark]) - half, 0.0))
        # A square that is nearer has its centre within this.
        others = self._border.query_ball_point(points, first + half * np.sqrt(2.0) * (1 + 1e-9), workers=-1)
        counts = np.fromiter((len(some) for some in others), np.int64, len(points))
        marks = np.concatenate([np.asarray(some, np.int64) for some in others])
        gap = np.maximum(np.abs(np.repeat(points, counts, axis=0) - self._border.data[marks]) - half, 0.0)
        starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
        least: Floats = np.minimum.reduceat(norm(gap), starts)
        return np.minimum(first, least)

    @cached_property
    def _border(self) -> "cKDTree | None":
        """The centres of the unobserved marks beside observed ones."""
        seen = np.pad(self.observed, 1)
        beside = seen[1:-1, :-2] | seen[1:-1, 2:] | seen[:-2, 1:-1] | seen[2:, 1:-1]
        row, column = np.nonzero(~self.observed & beside)
        if not len(row):
            return None
        side = self.lattice.resolution / self._per_cell
        return cKDTree(np.array(self.lattice.origin) + (np.stack([column, row], axis=-1) + 0.5) * side)
