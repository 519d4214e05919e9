"""Straight pieces of surface, and the distance to the nearest one.

A vector field describes surfaces well and the space between them badly, so a vector map's distance is that to its
facets: to the nearest point q of any of them, along d = (p - q) / |p - q|, with the variance
    (n.d)^2 (sigma^2 + (STRAY h)^2) + (t.d)^2 (END h)^2
where n, t are the facet's normal and tangent, sigma the field's standard deviation across it, and the second term is
for where the surface ends (END) or turns away (TURN). The constants are the service's.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..records import KINDS, Kind
from ..spline.lattice import Floats, Integers, Marks

END = 0.4
TURN = 0.25
STRAY = 0.03
ON_THE_SURFACE = 1e-9


class Feet(NamedTuple):
    """The surface points nearest to places, and what is known of the distances."""

    point: Floats
    distance: Floats
    sigma: Floats
    away: Floats
    """The unit vector away from the surface; across it where the place lies on it."""


@dataclass(frozen=True)
class Facets:
    """A map's facets: `ends` (n, 2, 2), `sigma` (n, 2) by kind, `open` (n, 2): whether the surface ends there."""

    ends: Floats
    sigma: Floats
    open: Marks
    resolution: float

    def __len__(self) -> int:
        return len(self.ends)

    def whole(self) -> "Facets":
        """Those that have a length."""
        long = ~same(self.ends[:, 0], self.ends[:, 1])
        return Facets(self.ends[long], self.sigma[long], self.open[long], self.resolution)

    @cached_property
    def span(self) -> Floats:
        """From one end to the other."""
        return self.ends[:, 1] - self.ends[:, 0]

    @cached_property
    def length(self) -> Floats:
        """Metres."""
        return norm(self.span)

    @cached_property
    def along(self) -> Floats:
        """The unit vector from the first end to the second."""
        return self.span / self.length[:, None]

    @cached_property
    def normal(self) -> Floats:
        """The unit vector across the facet."""
        return turned(self.along)

    def back(self, places: Floats, which: Integers) -> tuple[Floats, Floats]:
        """From the nearest points of facets (n, k) to places (n, 2), x and y: what a search needs of many pairs."""
        x, y = places[:, 0, None], places[:, 1, None]
        start_x, start_y, span_x, span_y = (column[which] for column in self._columns)
        share = ((x - start_x) * span_x + (y - start_y) * span_y) / (span_x * span_x + span_y * span_y)
        share = np.clip(share, 0.0, 1.0, out=share)
        return x - (start_x + span_x * share), y - (start_y + span_y * share)

    def feet(self, places: Floats, which: Integers, kind: Kind) -> Feet:
        """The feet of places (n, 2), each on one facet (n)."""
        start = self.ends[which, 0]
        span = self.span[which]
        share = np.clip(dot(places - start, span) / dot(span, span), 0.0, 1.0)
        point = start + span * share[:, None]
        back = places - point
        distance = norm(back)
        along, normal = self.along[which], self.normal[which]
        on_it = (distance <= ON_THE_SURFACE)[:, None]
        away = np.where(on_it, normal, back / np.where(on_it, 1.0, distance[:, None]))
        across = np.hypot(self.sigma[which, KINDS.index(kind)], STRAY * self.resolution)
        opened = self.open[which]
        at_end = ((share == 0.0) & opened[:, 0]) | ((share == 1.0) & opened[:, 1])
        tangential = np.where(at_end, END, TURN) * self.resolution
        sigma = np.hypot(dot(normal, away) * across, dot(along, away) * tangential)
        return Feet(point, distance, sigma, away)

    @cached_property
    def _columns(self) -> tuple[Floats, ...]:
        return tuple(np.ascontiguousarray(c) for c in (*self.ends[:, 0].T, *self.span.T))


def dot(a: Floats, b: Floats) -> Floats:
    """The inner product of vectors of the plane."""
    product: Floats = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]
    return product


def norm(v: Floats) -> Floats:
    """The length of vectors of the plane."""
    return np.sqrt(dot(v, v))


def turned(v: Floats) -> Floats:
    """A quarter turn counter-clockwise."""
    return np.stack([-v[..., 1], v[..., 0]], axis=-1)


def same(a: Floats, b: Floats) -> Marks:
    """Whether points are the same to the last bit."""
    both: Marks = np.all(a == b, axis=-1)
    return both
