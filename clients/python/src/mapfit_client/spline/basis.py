"""The uniform cubic B-spline basis and its tensor product over one cell.

On [0, 1] the four basis functions that do not vanish are
    (1-t)^3/6, (3t^3-6t^2+4)/6, (-3t^3+3t^2+3t+1)/6, t^3/6.
In a cell a surface is the sum over a, b of B_a(t) B_b(w) c(i+a, j+b): 16 numbers, a row, times 16 coefficients.
"""

from typing import NamedTuple

import numpy as np

from .lattice import Floats


class Rows(NamedTuple):
    """What a surface's value and slopes (per metre) are in terms of its cell's 16 control points, x fastest."""

    value: Floats
    dx: Floats
    dy: Floats


def rows(local: Floats, resolution: float) -> Rows:
    """The rows at local coordinates of cells with this side."""
    x, y = _values(local[:, 0]), _values(local[:, 1])
    x_slope, y_slope = _slopes(local[:, 0]) / resolution, _slopes(local[:, 1]) / resolution
    return Rows(_product(x, y), _product(x_slope, y), _product(x, y_slope))


def _values(t: Floats) -> Floats:
    s = 1 - t
    four = [s**3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]
    return np.stack(four, axis=-1) / 6


def _slopes(t: Floats) -> Floats:
    s = 1 - t
    return np.stack([-(s**2), 3 * t**2 - 4 * t, -3 * t**2 + 2 * t + 1, t**2], axis=-1) / 2


def _product(x: Floats, y: Floats) -> Floats:
    product: Floats = (y[:, :, None] * x[:, None, :]).reshape(-1, 16)
    return product
