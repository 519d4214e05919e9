"""Where scans were taken, as the service answers."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .records import Pose
from .spline.lattice import Floats


@dataclass(frozen=True)
class LocalizedPose:
    """A scan's pose with its covariance (3, 3) in (x, y, theta); both None where the scan fits nowhere."""

    pose: Pose | None
    covariance: Floats | None
    converged: bool
    used: int
    """Returns that agree with the map."""
    left_out: int
    """Returns that do not."""
    chi_squared: float | None
    degrees_of_freedom: int | None
    hypotheses: list[dict[str, Any]]
    """`{pose, probability}`, the best first."""

    @classmethod
    def of(cls, record: Mapping[str, Any]) -> "LocalizedPose":
        """From the service's record."""
        covariance = record["covariance"]
        return cls(
            pose=record["pose"],
            covariance=None if covariance is None else np.array(covariance, float).reshape(3, 3),
            converged=record["converged"],
            used=record["used"],
            left_out=record["left_out"],
            chi_squared=record.get("chi_squared"),
            degrees_of_freedom=record.get("degrees_of_freedom"),
            hypotheses=record.get("hypotheses") or [],
        )
