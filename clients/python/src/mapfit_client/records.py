"""What the service says in JSON, by the names that this package gives it.

The types are made from the service's OpenAPI document (`schemas`, by `./generate`); here are those that one meets, and
what only a client knows.
"""

from typing import NotRequired, TypedDict

from .schemas import Distance, Fault, JobStatus, Kind, Pose
from .schemas import Fit as FitRecord
from .schemas import FittedPose as PosedScan
from .schemas import Job as JobRecord
from .schemas import Lattice as LatticeRecord
from .schemas import Map as MapRecord
from .schemas import Place as PlaceRecord

__all__ = [
    "ENDED",
    "KINDS",
    "Distance",
    "Fault",
    "FitRecord",
    "JobRecord",
    "JobStatus",
    "Kind",
    "LatticeRecord",
    "MapRecord",
    "PlaceRecord",
    "Pose",
    "PosedScan",
    "Problem",
    "problem_of",
]

KINDS: tuple[Kind, Kind] = ("propagated", "posterior")
ENDED: frozenset[JobStatus] = frozenset({"successful", "failed", "dismissed"})


class Problem(TypedDict):
    """An RFC 9457 problem: of a request, of a failed job, or, with the status 0, of a client that had no answer."""

    type: str
    title: str
    status: int
    detail: str
    instance: NotRequired[str]
    request_id: NotRequired[str]
    errors: NotRequired[list[Fault]]


def problem_of(job: JobRecord) -> Problem | None:
    """Why a job failed."""
    if (report := job["problem"]) is None:
        return None
    return {
        "type": report["type"],
        "title": report["title"],
        "status": report["status"],
        "detail": report["detail"],
    }
