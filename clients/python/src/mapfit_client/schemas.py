"""Every type that the service names, as its OpenAPI document has it. Made by ./generate; not by hand."""

from __future__ import annotations

from typing import Literal, NotRequired, TypeAlias, TypedDict


class Amount(TypedDict):
    """
    How much there is, where that is counted, and how much there may be; null is without limit.
    """

    limit: int | None
    used: int | None


Binary: TypeAlias = bytes
"""
A file's bytes, for the document.
"""


class Bounds(TypedDict):
    """
    Metres.
    """

    max: list[float]
    min: list[float]


class CostEstimate(TypedDict):
    """
    On a machine like the one this version was measured on.
    """

    bytes: int
    """
    Of memory, at the most.
    """
    seconds: float


class Delivery(TypedDict):
    """
    An event told, or to be told.
    """

    attempts: int
    created: str | None
    error: str | None
    """
    Why the last attempt failed.
    """
    event: str
    id: str
    """
    The `webhook-id` of its requests: the same for every attempt.
    """
    last_attempt: str | None
    next_attempt: str | None
    """
    Null once it is delivered or has failed for good.
    """
    status: str
    """
    `pending`, `delivered` or `failed`
    """
    webhook_id: str


Distance: TypeAlias = Literal["sdf", "vdf"]
"""
Which distance a map holds.
"""


DistanceName: TypeAlias = Literal["sdf", "vdf"]
"""
`sdf`: signed, negative in free space. `vdf`: the vector from the nearest surface point.
"""


Event: TypeAlias = Literal["job.successful", "job.failed", "job.dismissed", "place.published"]
"""
Of what one can be told.
"""


class Fault(TypedDict):
    """
    One fault: of the body, by a JSON Pointer (RFC 6901), or of a query parameter, by its name.
    """

    detail: str
    parameter: NotRequired[str | None]
    pointer: NotRequired[str | None]


FieldName: TypeAlias = Literal[
    "distance",
    "gradient",
    "sigma",
    "nearest",
    "clearance",
    "observed",
    "gradient_covariance",
    "distance_gradient_covariance",
    "vector",
    "vector_covariance",
]
"""
An array of the answer.
"""


class Health(TypedDict):
    """
    Health in one word.
    """

    status: str


JobStatus: TypeAlias = Literal["accepted", "running", "successful", "failed", "dismissed"]
"""
Where a job stands.
"""


Kind: TypeAlias = Literal["propagated", "posterior"]
"""
Which covariance; see the module.
"""


class Lattice(TypedDict):
    """
    A lattice of control points; cell (i, j) of it has the control points (i..i+3, j..j+3).
    """

    cells: list[int]
    """
    Along x and y.
    """
    control_points: list[int]
    origin: list[float]
    """
    Its lower left corner, metres.
    """
    resolution: float
    """
    The spacing, metres.
    """


class Motion(TypedDict):
    """
    A motion from one scan to the next, in the frame of the former.
    """

    covariance: list[float]
    """
    Row-major in (x, y, theta), symmetric positive definite.
    """
    theta: float
    x: float
    y: float


class NewVersion(TypedDict):
    """
    What to publish.
    """

    map_id: str
    note: NotRequired[str | None]


class NewWebhook(TypedDict):
    """
    Whom to tell of what.
    """

    events: list[Event]
    secret: NotRequired[str | None]
    """
    `whsec_` and 24 to 64 bytes in base64, as Standard Webhooks has them; one is made where it is missing.
    """
    url: str
    """
    http or https; deliveries are POSTs to it.
    """


class Noise(TypedDict):
    """
    Standard deviations: metres, and radians for theta.
    """

    sigma_range: float
    sigma_theta: float
    sigma_x: float
    sigma_y: float


class OnLattice(TypedDict):
    """
    A number a control point, x fastest; null where one is not in use. A signed map has `sdf`, a vector map the others.
    """

    sdf: NotRequired[list[float | None] | None]
    vdf_x: NotRequired[list[float | None] | None]
    vdf_y: NotRequired[list[float | None] | None]


class Item(TypedDict):
    """
    An event told, or to be told.
    """

    attempts: int
    created: str | None
    error: str | None
    """
    Why the last attempt failed.
    """
    event: str
    id: str
    """
    The `webhook-id` of its requests: the same for every attempt.
    """
    last_attempt: str | None
    next_attempt: str | None
    """
    Null once it is delivered or has failed for good.
    """
    status: str
    """
    `pending`, `delivered` or `failed`
    """
    webhook_id: str


class PageDelivery(TypedDict):
    """
    One page of a list.
    """

    items: list[Item]
    next_cursor: str | None
    """
    For `?cursor=`; null on the last page.
    """


class Item3(TypedDict):
    """
    A place, or a version of it.
    """

    links: dict[str, str]
    """
    Addresses by relation.
    """
    map_id: str
    name: str
    note: str | None
    published: str | None
    sha256: str | None
    """
    Of the map's file as it is stored, in hexadecimal; null where a version from before these were kept fitted it.
    """
    version: int
    """
    1 for the first map published there.
    """


class PagePlace(TypedDict):
    """
    One page of a list.
    """

    items: list[Item3]
    next_cursor: str | None
    """
    For `?cursor=`; null on the last page.
    """


class Item4(TypedDict):
    """
    A webhook.
    """

    created: str | None
    events: list[str]
    id: str
    secret: NotRequired[str]
    """
    In the answer to its creation alone.
    """
    url: str


class PageWebhook(TypedDict):
    """
    One page of a list.
    """

    items: list[Item4]
    next_cursor: str | None
    """
    For `?cursor=`; null on the last page.
    """


class Parts(TypedDict):
    """
    How many parts a job has, and how far they are: branches of the elimination, each of which is a thread's. A fit passes
    over all of them several times, and its covariance once more.
    """

    done: int
    """
    In this pass.
    """
    running: int
    total: int


class Place(TypedDict):
    """
    A place, or a version of it.
    """

    links: dict[str, str]
    """
    Addresses by relation.
    """
    map_id: str
    name: str
    note: str | None
    published: str | None
    sha256: str | None
    """
    Of the map's file as it is stored, in hexadecimal; null where a version from before these were kept fitted it.
    """
    version: int
    """
    1 for the first map published there.
    """


Point: TypeAlias = list[float]
"""
[x, y], metres.
"""


class Pose(TypedDict):
    """
    Where a sensor was and which way it looked: metres, radians.
    """

    theta: float
    x: float
    y: float


Poses: TypeAlias = Literal["fixed", "refined"]
"""
Whether the scans' poses are unknowns of the fit.
"""


PosesName: TypeAlias = Literal["fixed", "refined"]
"""
Whether poses are unknowns of the fit.
"""


class Preview(TypedDict):
    """
    Where a recording's scans lie, to the millimetre: up to 20,000 points each, taken evenly.
    """

    poses: list[list[float]]
    """
    Where they were taken: [x, y], metres.
    """
    returns: list[list[float]]
    """
    [x, y], metres.
    """


class Problem(TypedDict):
    """
    An RFC 9457 problem.
    """

    detail: str
    errors: NotRequired[list[Fault]]
    """
    Of a 422: every fault.
    """
    instance: str
    request_id: str
    status: int
    title: str
    type: str
    """
    A stable URI that ends in a slug.
    """


class ProblemReport(TypedDict):
    """
    Why a job failed, in the members of RFC 9457.
    """

    detail: str
    status: int
    title: str
    type: str


class Progress(TypedDict):
    """
    How far a job is.
    """

    iteration: int
    max_iterations: int
    objective: NotRequired[float | None]
    percent: float
    """
    0 to 100; an estimate while the fit runs.
    """
    stage: str
    """
    `queued`, `preparing`, `waiting for memory`, `aligning` (of a join), `fitting`, `covariance`, `storing` or `done`.
    """


class QueryAnswer(TypedDict):
    """
    Arrays in the order of the points, those of `fields`; a point outside the lattice has nulls, and one where no control
    points are in use has nothing but `observed` and `clearance`.
    """

    clearance: NotRequired[list[float | None]]
    """
    The unsigned distance to the nearest surface or to space that nobody observed, whichever is nearer, metres.
    """
    distance: NotRequired[list[float | None]]
    """
    To the nearest surface, metres; of an sdf negative in free space.
    """
    distance_gradient_covariance: NotRequired[list[list[float] | None]]
    """
    sdf alone: the distance's covariance with the gradient, [dx, dy].
    """
    gradient: NotRequired[list[list[float] | None]]
    gradient_covariance: NotRequired[list[list[float] | None]]
    """
    sdf alone: [xx, xy, yy]
    """
    kind: str
    nearest: NotRequired[list[list[float] | None]]
    """
    The surface point that the distance is measured from; null where the map has no surface.
    """
    observed: NotRequired[list[bool | None]]
    """
    Whether there is evidence here: a beam passed, or a surface was met within half a cell.
    """
    sigma: NotRequired[list[float | None]]
    """
    The standard deviation of the distance, metres.
    """
    vector: NotRequired[list[list[float] | None]]
    """
    vdf alone: the spline's value, metres.
    """
    vector_covariance: NotRequired[list[list[float] | None]]
    """
    vdf alone: [xx, xy, yy]
    """


class QueryBody(TypedDict):
    """
    What is asked.
    """

    fields: NotRequired[list[FieldName] | None]
    """
    The arrays to answer with; all by default.
    """
    kind: NotRequired[Kind | None]
    points: list[Point]
    """
    [x, y] each, metres.
    """


class Relabelling(TypedDict):
    """
    What to change.
    """

    labels: NotRequired[dict[str, str]]
    """
    In place of those there are.
    """
    name: NotRequired[str | None]
    """
    Null takes it away.
    """


class Rollback(TypedDict):
    """
    Which version to publish again.
    """

    version: int


class Scan(TypedDict):
    """
    One laser scan; beam k has bearing angle_min + k angle_increment from the pose's heading.
    """

    angle_increment: float
    angle_min: float
    pose: Pose
    pose_covariance: NotRequired[list[float] | None]
    """
    Row-major in (x, y, theta), symmetric positive semi-definite; replaces sigma_x, sigma_y and sigma_theta.
    """
    range_max: float
    range_min: float
    ranges: list[float | None]
    """
    Metres; null, or outside [range_min, range_max], is no return.
    """


class SightedScan(TypedDict):
    """
    A job's scan, whose pose is what is known of it beforehand; null is anywhere on the map.
    """

    angle_increment: float
    angle_min: float
    pose: Pose | None
    pose_covariance: NotRequired[list[float] | None]
    range_max: float
    range_min: float
    ranges: list[float | None]
    """
    Metres; null, or outside [range_min, range_max], is no return.
    """


class StageSeconds(TypedDict):
    """
    Seconds a map took, by stage.
    """

    covariance: float
    fitting: float


Tiling: TypeAlias = Literal["auto", "none"]


class Usage(TypedDict):
    """
    What a tenant has, and what it may have.
    """

    maps: Amount
    queued_jobs: Amount
    requests_a_second: Amount
    """
    A key.
    """
    running_jobs: Amount
    stored_bytes: Amount
    """
    Of maps.
    """
    tenant: str


class Webhook(TypedDict):
    """
    A webhook.
    """

    created: str | None
    events: list[str]
    id: str
    secret: NotRequired[str]
    """
    In the answer to its creation alone.
    """
    url: str


Weighting: TypeAlias = Literal["paper", "calibrated"]
"""
Which objective is minimised.
"""


WeightingName: TypeAlias = Literal["paper", "calibrated"]
"""
The published objective, or ours.
"""


class Weights(TypedDict):
    """
    The weights a fit used.
    """

    eikonal: float
    """
    `rho_e`, in the unit that `eikonal_unit` names.
    """
    eikonal_scale: NotRequired[float | None]
    """
    The Geman-McClure scale; `null` for the squared loss.
    """
    eikonal_unit: str
    model_sigma: float
    """
    The standard deviation that stands for what the spline cannot follow, metres.
    """
    observation: str
    """
    `frozen` (the published form) or `sampson`.
    """
    poses: Poses
    """
    Whether the poses were unknowns of the fit.
    """
    smoothing: float
    """
    The thin-plate weight.
    """


class Window(TypedDict):
    """
    A window of control points: first column and row, and how many.
    """

    i0: int
    j0: int
    ni: int
    nj: int


class Block(TypedDict):
    """
    The dense covariance of a window's coefficients, square metres; null where a control point is not in use.
    """

    form: str
    kind: Kind
    matrix: list[list[float | None]]
    """
    Row by row, x fastest within the window; a vector map has the x set before the y set.
    """
    window: Window | None


class Coefficients(OnLattice):
    """
    A map's coefficients.
    """

    lattice: Lattice


class Diagonal(OnLattice):
    """
    Variances of the coefficients, square metres.
    """

    form: str
    kind: Kind
    lattice: Lattice


class DryRun(TypedDict):
    """
    What a job's map would be, and what its fit would take.
    """

    control_points: int
    """
    In use, of each component.
    """
    estimate: CostEstimate
    lattice: Lattice
    preview: NotRequired[Preview | None]
    returns: int
    scans: int


class Fit(TypedDict):
    """
    What a fit reports about itself.
    """

    active_control_points: NotRequired[int | None]
    """
    The control points in use, where these are not all.
    """
    converged: bool
    """
    Stationary within tolerance, and the exact Hessian positive definite.
    """
    cut_locus: NotRequired[float | None]
    """
    Of a vector map: the share of the space fitted that lies at the cut locus, where the field jumps.
    """
    factorisations: int
    gradient_norm: float
    """
    The largest absolute entry of the gradient at the end.
    """
    iterations: int
    objective: float
    observations: int
    """
    Returns inside the map.
    """
    positive_definite: bool
    relative_gradient: float
    """
    `gradient_norm` over the start's.
    """
    rms: NotRequired[float | None]
    """
    How far the surfaces miss the returns that were taken, root mean square, metres.
    """
    seconds: float
    """
    How long the fit and its covariance took.
    """
    seen_through: NotRequired[float | None]
    """
    The share of the returns left out because beams of other scans passed where they were.
    """
    stages: NotRequired[StageSeconds]
    """
    The same by stage.
    """
    unconverged: NotRequired[str | None]
    """
    Why the fit did not converge, where it did not.
    """
    weighting: Weighting
    weights: Weights


class FitRequest(TypedDict):
    """
    How to fit it; everything is optional.
    """

    band: NotRequired[float | None]
    """
    Control points are in use where evidence is at most this many cells away, and null elsewhere. By default an sdf
    has all, and a vdf those within half a cell, or two standard deviations of its poses where these are refined.
    """
    eikonal_scale: NotRequired[float | None]
    """
    The Geman-McClure scale of the Eikonal residual.
    """
    eikonal_weight: NotRequired[float | None]
    """
    Per quadrature point for paper, per square metre for calibrated.
    """
    max_iterations: NotRequired[int | None]
    model_sigma: NotRequired[float | None]
    """
    What stands for what the spline cannot follow, metres; 2.5 % of the resolution by default.
    """
    poses: NotRequired[PosesName | None]
    smoothing: NotRequired[float | None]
    """
    The thin-plate weight.
    """
    tolerance: NotRequired[float | None]
    """
    The relative gradient that counts as converged; 1e-8 by default.
    """
    weighting: NotRequired[WeightingName | None]


class FittedPose(TypedDict):
    """
    A pose with its covariances, row-major in (x, y, theta); null where poses were fixed.
    """

    covariance: list[float] | None
    pose: Pose
    posterior_covariance: list[float] | None


class FittedPoses(TypedDict):
    """
    The poses of a map's scans.
    """

    poses: list[FittedPose]
    treatment: Poses


class Frame(TypedDict):
    """
    Where a map's frame lies in the joined map's.
    """

    covariance: list[float]
    """
    Row-major in (x, y, theta); zero of the first, which is held.
    """
    map_id: str
    pose: Pose


class Frames(TypedDict):
    """
    The frames of a joined map; none of any other.
    """

    frames: list[Frame]


class Hypothesis(TypedDict):
    """
    A pose, and how probable it is among those that were found.
    """

    pose: Pose
    probability: float


class Job(TypedDict):
    """
    A job.
    """

    attempt: int
    """
    How often the job was begun.
    """
    created: str | None
    deadline: str | None
    """
    Past it the job has failed.
    """
    finished: str | None
    id: str
    labels: dict[str, str]
    links: dict[str, str]
    """
    Addresses by relation: self, events, request, and map once there is one.
    """
    map_id: str | None
    """
    Set once successful.
    """
    message: str | None
    name: str | None
    parts: Parts | None
    priority: int
    problem: ProblemReport | None
    progress: Progress
    retry_of: str | None
    """
    The job that this one tries again.
    """
    started: str | None
    status: JobStatus
    updated: str | None


class JoinedMap(TypedDict):
    """
    A map to be joined, and where its frame lies in the joined one.
    """

    id: str
    pose: NotRequired[Pose | None]
    pose_covariance: NotRequired[list[float] | None]
    """
    Row-major in (x, y, theta): how good the guess is; 0.5 m and 0.15 rad where it is left out.
    """


class JoinedMapSpec(TypedDict):
    """
    The map that maps are joined into.
    """

    bounds: NotRequired[Bounds | None]
    distance: NotRequired[DistanceName | None]
    margin: NotRequired[float | None]
    """
    Metres; three cells by default.
    """
    resolution: float
    """
    The spacing of control points, metres.
    """
    tiling: NotRequired[Tiling | None]


class LocalizeBody(TypedDict):
    """
    What is asked.
    """

    hypotheses: NotRequired[int | None]
    """
    Distinct poses a scan, at most; 1 by default.
    """
    kind: NotRequired[Kind | None]
    motions: NotRequired[list[Motion] | None]
    """
    One fewer than scans: makes them one trajectory.
    """
    noise: Noise
    scans: list[SightedScan]
    """
    At most 1,000; along one trajectory, 200.
    """


class LocatedScan(TypedDict):
    """
    Where a scan was taken.
    """

    chi_squared: float
    converged: bool
    covariance: list[float] | None
    """
    Row-major in (x, y, theta), the map's own uncertainty included.
    """
    degrees_of_freedom: int
    hypotheses: list[Hypothesis]
    """
    The best first.
    """
    left_out: int
    pose: Pose | None
    used: int
    """
    Returns that agree with the map.
    """


class Map(TypedDict):
    """
    A map, as clients see it.
    """

    created: str | None
    distance: Distance
    fit: Fit
    frame_id: str
    id: str
    job_id: str
    labels: dict[str, str]
    lattice: Lattice
    links: dict[str, str]
    """
    Addresses by relation.
    """
    name: str | None
    parent: str | None
    """
    The map that this one grew from; null of a first fit.
    """
    version: int
    """
    1 for a first fit.
    """


class MapRequest(TypedDict):
    """
    The map to fit.
    """

    bounds: NotRequired[Bounds | None]
    distance: DistanceName
    margin: NotRequired[float | None]
    """
    Metres; three cells by default.
    """
    resolution: float
    """
    The spacing of control points, metres.
    """
    tiling: NotRequired[Tiling | None]


class Item1(TypedDict):
    """
    A job.
    """

    attempt: int
    """
    How often the job was begun.
    """
    created: str | None
    deadline: str | None
    """
    Past it the job has failed.
    """
    finished: str | None
    id: str
    labels: dict[str, str]
    links: dict[str, str]
    """
    Addresses by relation: self, events, request, and map once there is one.
    """
    map_id: str | None
    """
    Set once successful.
    """
    message: str | None
    name: str | None
    parts: Parts | None
    priority: int
    problem: ProblemReport | None
    progress: Progress
    retry_of: str | None
    """
    The job that this one tries again.
    """
    started: str | None
    status: JobStatus
    updated: str | None


class PageJob(TypedDict):
    """
    One page of a list.
    """

    items: list[Item1]
    next_cursor: str | None
    """
    For `?cursor=`; null on the last page.
    """


class Item2(TypedDict):
    """
    A map, as clients see it.
    """

    created: str | None
    distance: Distance
    fit: Fit
    frame_id: str
    id: str
    job_id: str
    labels: dict[str, str]
    lattice: Lattice
    links: dict[str, str]
    """
    Addresses by relation.
    """
    name: str | None
    parent: str | None
    """
    The map that this one grew from; null of a first fit.
    """
    version: int
    """
    1 for a first fit.
    """


class PageMap(TypedDict):
    """
    One page of a list.
    """

    items: list[Item2]
    next_cursor: str | None
    """
    For `?cursor=`; null on the last page.
    """


RecordingOptions = TypedDict(
    "RecordingOptions",
    {
        "deadline_seconds": NotRequired[float | None],
        "every": NotRequired[int | None],
        "fit": NotRequired[FitRequest | None],
        "from": NotRequired[int | None],
        "labels": NotRequired[dict[str, str]],
        "map": MapRequest,
        "name": NotRequired[str | None],
        "noise": Noise,
        "pose_topic": NotRequired[str | None],
        "priority": NotRequired[int | None],
        "scan_topic": NotRequired[str | None],
        "to": NotRequired[int | None],
    },
)


class RecordingRequest(TypedDict):
    """
    A recording that has the scans, and what a job's body has beside them.
    """

    options: RecordingOptions
    recording: bytes
    """
    An MCAP recording of a ROS 2 robot or a CARMEN log; it may be gzipped.
    """


Submitted: TypeAlias = Job | DryRun
"""
A job that was there already, or what one would be.
"""


class UpdateRequest(TypedDict):
    """
    New scans for a map that is there: a job request without `map`.
    """

    deadline_seconds: NotRequired[float | None]
    """
    From submission; past it the job is failed.
    """
    fit: NotRequired[FitRequest | None]
    labels: NotRequired[dict[str, str]]
    """
    Keys have no colon; 64 labels at most, 256 bytes each.
    """
    name: NotRequired[str | None]
    noise: Noise
    """
    Of these scans; those of before keep theirs.
    """
    priority: NotRequired[int | None]
    """
    Higher runs first.
    """
    scans: list[Scan]


Covariance: TypeAlias = Diagonal | Block
"""
Either, by `form`.
"""


class JobRequest(TypedDict):
    """
    A job request.
    """

    deadline_seconds: NotRequired[float | None]
    """
    From submission; past it the job is failed.
    """
    fit: NotRequired[FitRequest | None]
    labels: NotRequired[dict[str, str]]
    """
    Keys have no colon; 64 labels at most, 256 bytes each.
    """
    map: MapRequest
    name: NotRequired[str | None]
    noise: Noise
    priority: NotRequired[int | None]
    """
    Higher runs first.
    """
    scans: list[Scan]


class JoinRequest(TypedDict):
    """
    Maps to be joined into one.
    """

    deadline_seconds: NotRequired[float | None]
    """
    From submission; past it the job is failed.
    """
    fit: NotRequired[FitRequest | None]
    labels: NotRequired[dict[str, str]]
    """
    Keys have no colon; 64 labels at most, 256 bytes each.
    """
    map: JoinedMapSpec
    maps: list[JoinedMap]
    """
    The first is held where its pose says.
    """
    name: NotRequired[str | None]
    priority: NotRequired[int | None]
    """
    Higher runs first.
    """


class Localization(TypedDict):
    """
    Poses in the scans' order.
    """

    poses: list[LocatedScan]


AcceptedRequest: TypeAlias = JobRequest | UpdateRequest | JoinRequest
"""
A request as it was accepted: a job's, an update's or a join's.
"""
