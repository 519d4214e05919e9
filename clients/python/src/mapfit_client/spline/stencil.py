"""Variances of a spline from the covariance of its coefficients.

Two control points share a cell where they are at most three apart along x and along y, and a point's variance
    row^T C row
needs no other entry of C. Of a symmetric matrix 25 of those 7 x 7 neighbours are enough; here they lie in a table,
a line for each control point, so that the form at many points is one look-up and a sum over 136 pairs.
"""

import numpy as np
import scipy.sparse as sp

from .lattice import Floats, Integers

SLOTS = 25


def slot(di: Integers, dj: Integers) -> Integers:
    """Where the neighbour (di, dj) away stands in a line: those behind a control point in the order of indices."""
    return np.where(dj == 0, di, 4 + (dj - 1) * 7 + di + 3)


_A, _B = np.tril_indices(16)
_PAIR_SLOT = slot(_A % 4 - _B % 4, _A // 4 - _B // 4)
_TWICE = np.where(_A == _B, 1.0, 2.0)


class Stencil:
    """A symmetric matrix between control points that share a cell."""

    def __init__(self, matrix: "sp.csc_array[np.float64]", columns: int) -> None:
        """`columns` is the number of control points along x."""
        entries = matrix.tocoo()
        lower = entries.row >= entries.col
        row, col = entries.row[lower].astype(np.int64), entries.col[lower].astype(np.int64)
        at = slot(row % columns - col % columns, row // columns - col // columns)
        self._table: Floats = np.zeros((matrix.shape[0], SLOTS))
        self._table[col, at] = entries.data[lower]
        self._pair_first: Integers = _B % 4 + (_B // 4) * columns

    def form(self, first: Integers, row: Floats) -> Floats:
        """row^T C row of each point, `first` the lowest control point of its cell."""
        entries = self._table[first[:, None] + self._pair_first, _PAIR_SLOT]
        form: Floats = np.einsum("nk,nk,nk->n", entries, row[:, _A], row[:, _B] * _TWICE)
        return form


def stencils(covariance: "sp.csc_array[np.float64]", columns: int, components: int) -> list[Stencil]:
    """A field's covariances between its components: [xx], or [xx, xy, yy], the cross one made symmetric.

    A form sees nothing of a matrix but its symmetric part, so nothing is lost.
    """
    if components == 1:
        return [Stencil(covariance, columns)]
    n = covariance.shape[0] // 2
    xx, xy, yy = covariance[:n, :n], covariance[:n, n:], covariance[n:, n:]
    cross = sp.csc_array((xy + xy.T) * 0.5)
    return [Stencil(sp.csc_array(xx), columns), Stencil(cross, columns), Stencil(sp.csc_array(yy), columns)]
