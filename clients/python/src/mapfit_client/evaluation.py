"""What a map says about points."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .records import Distance, Kind
from .spline.lattice import Floats, Marks

FIELDS = ("distance", "sigma", "gradient", "nearest", "clearance", "observed")
VECTOR_FIELDS = ("vector", "vector_covariance")
_WIDTH = {"gradient": 2, "nearest": 2, "vector": 2, "vector_covariance": 3}


@dataclass(frozen=True)
class Evaluation:
    """Arrays in the points' order and shape; NaN where there is no answer: outside the map, say."""

    kind: Kind
    """Which covariance sigma and vector_covariance are of."""
    distance: Floats
    """To the nearest surface, metres; a signed map's is negative in free space."""
    sigma: Floats
    """The distance's standard deviation, metres."""
    gradient: Floats
    """Of the distance, (..., 2)."""
    nearest: Floats
    """The surface point meant, (..., 2), metres."""
    clearance: Floats
    """To the nearest surface or to space that nobody observed, whichever is nearer, metres: for planners."""
    observed: Marks
    """Whether there is evidence here."""
    vector: Floats | None = None
    """Of a vector map the spline's value, (..., 2): from the nearest surface point, metres."""
    vector_covariance: Floats | None = None
    """Of a vector map [xx, xy, yy], (..., 3), square metres."""

    def __len__(self) -> int:
        return len(self.distance)

    def shaped(self, shape: tuple[int, ...]) -> "Evaluation":
        """The same with another shape of points."""
        arrays: dict[str, Any] = {
            field.name: value.reshape(shape + value.shape[1:])
            for field in fields(self)
            if isinstance(value := getattr(self, field.name), np.ndarray)
        }
        return replace(self, **arrays)

    @classmethod
    def joined(cls, kind: Kind, distance: Distance, parts: Sequence[Mapping[str, NDArray[Any]]]) -> "Evaluation":
        """One of several that follow one another."""
        names = FIELDS if distance == "sdf" else FIELDS + VECTOR_FIELDS
        return cls(kind, **{name: np.concatenate([_empty(name), *(part[name] for part in parts)]) for name in names})


def as_points(points: Any) -> tuple[Floats, tuple[int, ...]]:
    """Points as (n, 2), and the shape they came in."""
    array = np.asarray(points, dtype=np.float64)
    if array.size == 0 and array.ndim == 1:
        return np.empty((0, 2)), (0,)
    if array.ndim == 0 or array.shape[-1] != 2:
        raise ValueError(f"points are pairs of x and y: the last axis must have 2 entries, the shape is {array.shape}")
    return array.reshape(-1, 2), array.shape[:-1]


def _empty(name: str) -> NDArray[Any]:
    shape = (0, _WIDTH[name]) if name in _WIDTH else (0,)
    return np.empty(shape, bool if name == "observed" else float)
