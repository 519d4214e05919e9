"""Occupancy grids as the service makes them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class OccupancyGrid:
    """A `nav_msgs/OccupancyGrid`: (rows, columns), the lowest y first, in 0..100 and -1 where nothing is known."""

    data: NDArray[np.int8]
    resolution: float
    origin: tuple[float, float]
    """The lower left corner, metres."""
    frame_id: str

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> "OccupancyGrid":
        """From the service's record."""
        info = record["info"]
        position = info["origin"]["position"]
        data = np.array(record["data"], np.int8).reshape(info["height"], info["width"])
        return cls(data, info["resolution"], (position["x"], position["y"]), record["header"]["frame_id"])
