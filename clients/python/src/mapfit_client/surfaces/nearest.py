"""The nearest facet of many places at once, exactly.

Every facet has seeds along it, none farther than `spacing / 2` from any of its points, in a k-d tree. A facet none of
whose seeds is among a place's k nearest seeds is farther away than the k-th seed's distance less `spacing / 2`; where
that is beyond everything that matters to the place (its nearest facet, and rivals within three standard deviations of
it), the k seeds' facets were enough. Places for which they were not are asked again with four times as many.
"""

from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from ..records import Kind
from ..spline.lattice import Floats, Integers
from .facets import ON_THE_SURFACE, Facets, Feet, dot
from .rivals import REACH, RIVAL, least_sigma

_FIRST_SEEDS = 16
_PAIRS_AT_ONCE = 200_000
_ROUNDING = 1e-9


class Nearest:
    """An index over facets, of which there must be one at least."""

    def __init__(self, facets: Facets) -> None:
        self._facets = facets
        # Fine enough to tell facets apart, and not so fine that there are many more seeds than facets.
        spacing = float(np.clip(2 * np.median(facets.length), 0.1 * facets.resolution, facets.resolution))
        self._slack = 0.5 * spacing + _ROUNDING
        pieces = np.maximum(np.ceil(facets.length / spacing), 1).astype(np.int64)
        self._owner: Integers = np.repeat(np.arange(len(facets)), pieces)
        first = np.repeat(np.cumsum(pieces) - pieces, pieces)
        share = (np.arange(len(self._owner)) - first + 0.5) / pieces[self._owner]
        self._tree = cKDTree(facets.ends[self._owner, 0] + share[:, None] * facets.span[self._owner])

    def feet(self, places: Floats, kind: Kind, rivals: bool = True) -> Feet:
        """The foot of each place (n, 2) on the nearest facet; with `rivals` its sigma knows of other surfaces."""
        n = len(places)
        feet = Feet(np.empty((n, 2)), np.empty(n), np.empty(n), np.empty((n, 2)))
        left: Integers = np.arange(n)
        k = min(_FIRST_SEEDS, self._tree.n)
        while len(left):
            undecided = []
            for some in _pieces(left, max(1, _PAIRS_AT_ONCE // k)):
                own, reach, farthest = self._among(places[some], k, kind, REACH if rivals else 0.0)
                decided = (k == self._tree.n) | (farthest - self._slack > reach)
                for whole, part in zip(feet, own, strict=True):
                    whole[some[decided]] = part[decided]
                undecided.append(some[~decided])
            left = np.concatenate(undecided)
            k = min(4 * k, self._tree.n)
        return feet

    def _among(self, places: Floats, k: int, kind: Kind, sigmas: float) -> tuple[Feet, Floats, Floats]:
        """The feet by the k nearest seeds, how far what matters reaches, and how far away the k-th seed is."""
        found = self._tree.query(places, k=np.arange(1, k + 1), workers=-1)
        gaps, seeds = np.asarray(found[0]), np.asarray(found[1])
        which = self._owner[seeds]
        x, y = self._facets.back(places, which)
        distance = np.sqrt(x * x + y * y)
        line = np.arange(len(places))
        own = self._facets.feet(places, which[line, np.argmin(distance, axis=1)], kind)
        if sigmas == 0.0:
            return own, own.distance, gaps[:, -1]
        reach = own.distance + sigmas * own.sigma
        away_x, away_y = own.away[:, 0, None], own.away[:, 1, None]
        with np.errstate(invalid="ignore"):
            cosine = x / distance * away_x + y / distance * away_y
        on_it = np.nonzero(distance <= ON_THE_SURFACE)
        cosine[on_it] = dot(self._facets.normal[which[on_it]], own.away[on_it[0]])
        different = (cosine < RIVAL) & (distance <= reach[:, None])
        rivals = np.where(different, distance, np.inf)
        nearest = np.argmin(rivals, axis=1)
        rival = self._facets.feet(places, which[line, nearest], kind)
        with np.errstate(invalid="ignore", divide="ignore"):
            shared = least_sigma((own.distance, own.sigma), (rival.distance, rival.sigma))
        sigma = np.where(np.isfinite(rivals[line, nearest]), shared, own.sigma)
        return own._replace(sigma=sigma), np.where(np.isnan(reach), own.distance, reach), gaps[:, -1]


def _pieces(which: Integers, size: int) -> Iterator[Integers]:
    return (which[start : start + size] for start in range(0, len(which), size))
