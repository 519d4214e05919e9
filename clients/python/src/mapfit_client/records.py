"""What the service says in JSON, as types.

The names are those of the service's OpenAPI document; a test holds every one of these against it. Members that the
contract names and that not every version of the service has are `NotRequired`.
"""

from typing import Literal, NotRequired, TypedDict

Kind = Literal["propagated", "posterior"]
"""Which covariance: the input noise carried to the map, or the inverse Hessian."""
Distance = Literal["sdf", "vdf"]
"""Which distance a map holds: signed, or the vector from the nearest surface."""
JobStatus = Literal["accepted", "running", "successful", "failed", "dismissed"]

KINDS: tuple[Kind, Kind] = ("propagated", "posterior")
ENDED: frozenset[JobStatus] = frozenset({"successful", "failed", "dismissed"})


class Fault(TypedDict):
    """One fault of a request: by a JSON Pointer into its body, or by a query parameter's name."""

    pointer: NotRequired[str | None]
    parameter: NotRequired[str | None]
    detail: str


class Problem(TypedDict):
    """An RFC 9457 problem. `status` is 0 where there was no answer."""

    type: str
    title: str
    status: int
    detail: str
    instance: NotRequired[str]
    request_id: NotRequired[str]
    errors: NotRequired[list[Fault]]


class Pose(TypedDict):
    """Where a sensor was and which way it looked: metres, radians."""

    x: float
    y: float
    theta: float


class Progress(TypedDict):
    """How far a job is."""

    percent: float
    stage: str
    iteration: int
    max_iterations: int
    objective: NotRequired[float | None]


class JobRecord(TypedDict):
    """A job as the service has it."""

    id: str
    name: str | None
    labels: dict[str, str]
    status: JobStatus
    progress: Progress
    message: str | None
    created: str | None
    started: str | None
    finished: str | None
    updated: str | None
    attempt: int
    priority: int
    map_id: str | None
    problem: Problem | None
    links: dict[str, str]
    retry_of: str | None
    deadline: str | None
    parts: "Parts | None"


class Parts(TypedDict):
    """How many parts a job has that is fitted in parts, and how far they are."""

    total: int
    done: int
    running: int


class LatticeRecord(TypedDict):
    """Control points `resolution` metres apart; cell (i, j) has the control points (i..i+3, j..j+3)."""

    origin: list[float]
    resolution: float
    cells: list[int]
    control_points: list[int]


class StageSeconds(TypedDict):
    """Seconds a map took, by stage."""

    fitting: float
    covariance: float


class Weights(TypedDict):
    """The weights a fit used."""

    eikonal: float
    eikonal_unit: str
    eikonal_scale: NotRequired[float | None]
    smoothing: float
    observation: str
    model_sigma: float
    poses: str


class FitRecord(TypedDict):
    """What a fit reports about itself."""

    weighting: str
    converged: bool
    iterations: int
    factorisations: int
    objective: float
    gradient_norm: float
    relative_gradient: float
    positive_definite: bool
    observations: int
    seconds: float
    weights: Weights
    stages: NotRequired[StageSeconds]
    unconverged: NotRequired[str | None]
    rms: NotRequired[float | None]
    seen_through: NotRequired[float | None]
    cut_locus: NotRequired[float | None]
    active_control_points: NotRequired[int | None]


class MapRecord(TypedDict):
    """A map as the service has it, without its arrays."""

    id: str
    job_id: str
    name: str | None
    labels: dict[str, str]
    created: str | None
    distance: Distance
    frame_id: str
    lattice: LatticeRecord
    fit: FitRecord
    links: dict[str, str]
    parent: str | None
    version: int


class PlaceRecord(TypedDict):
    """A name under which maps follow one another."""

    name: str
    version: int
    map_id: str
    published: str
    sha256: NotRequired[str]
    links: NotRequired[dict[str, str]]
    note: NotRequired[str | None]


class PosedScan(TypedDict):
    """A pose as a fit has it, with its covariances, row-major in (x, y, theta); None where poses were fixed."""

    pose: Pose
    covariance: list[float] | None
    posterior_covariance: list[float] | None
