"""The lattice of control points: where cells lie and which control points they touch.

A lattice of nx x ny cells with side h has (nx+3) x (ny+3) control points, x fastest: control point (i, j) has index
i + j (nx+3), and cell (i, j) touches the control points (i..i+3, j..j+3).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..records import LatticeRecord

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Marks = NDArray[np.bool_]


class Located(NamedTuple):
    """Of each point whether it is on the lattice, its cell, and its coordinates in that cell, both in [0, 1]."""

    inside: Marks
    cell: Integers
    local: Floats


@dataclass(frozen=True)
class Lattice:
    """A uniform lattice: lower left corner, spacing, and the number of cells along x and y."""

    origin: tuple[float, float]
    resolution: float
    cells: tuple[int, int]

    @classmethod
    def of(cls, record: LatticeRecord) -> "Lattice":
        """The lattice that the service describes."""
        (x, y), (nx, ny) = record["origin"], record["cells"]
        return cls((x, y), record["resolution"], (nx, ny))

    @property
    def control_points(self) -> int:
        """How many there are."""
        return (self.cells[0] + 3) * (self.cells[1] + 3)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(min x, min y, max x, max y) of the cells."""
        (x, y), (nx, ny), h = self.origin, self.cells, self.resolution
        return x, y, x + nx * h, y + ny * h

    def locate(self, points: Floats) -> Located:
        """The cells that points lie in; the upper and right edges belong to the last cells."""
        cells = np.array(self.cells, float)
        with np.errstate(invalid="ignore"):
            place = _snapped((points - np.array(self.origin)) / self.resolution)
            inside = np.all((place >= 0) & (place <= cells), axis=-1)
        place = np.where(inside[:, None], place, 0.0)
        cell = np.minimum(np.floor(place), cells - 1)
        return Located(inside, cell.astype(np.int64), place - cell)

    def support(self, cell: Integers) -> Integers:
        """The 16 control points of each cell; entry a + 4 b is that at (i + a, j + b)."""
        row = self.cells[0] + 3
        k = np.arange(16)
        first: Integers = cell[:, 0] + cell[:, 1] * row
        return first[:, None] + (k % 4 + (k // 4) * row)


def _snapped(place: Floats) -> Floats:
    """The nearest integer where rounding noise alone keeps a number from it (8 / 0.2 is not quite 40)."""
    nearest = np.rint(place)
    return np.where(np.abs(place - nearest) <= 1e-9 * np.maximum(np.abs(nearest), 1.0), nearest, place)
