"""Rows of the table that make the service work or hold much. Each gives a list of complaints."""

import gzip
import json
import time

from jobs import rooms
from service.connection import Connection
from service.zstd_frames import frame

from .attack import message
from .queries import HEADER, NPY, npy
from .stage import Stage, judge, large_job, together

LIMIT = 64 << 20
# CPU-seconds that forty abandoned pictures may cost, the ordinary client's small jobs beside them included.
MOST_FOR_NOBODY = 15.0


def bombs(stage: Stage) -> list[str]:
    """60 zstd bodies of some kilobytes that unpack to 64 MiB each."""

    def one(number: int, complaints: list[str]) -> None:
        job = json.dumps(rooms.job(number, 0.8)).encode()
        body = frame(job, b" ", LIMIT - len(job) - 1)
        try:
            answer = Connection(stage.port, 120.0).ask("POST", "/v1/jobs", body, {"content-encoding": "zstd"})
            judge(complaints, "a bomb", answer, (202, 413, 429, 503))
        except OSError as error:
            complaints.append(f"a bomb: {error}")

    return together(60, one)


def members(stage: Stage) -> list[str]:
    """20 bodies of 8 million members each, packed: dear to hold, not only to unpack."""
    body = gzip.compress(b"{" + b",".join([b'"":null'] * 7_900_000) + b"}", 1)

    def one(_: int, complaints: list[str]) -> None:
        try:
            answer = Connection(stage.port, 120.0).ask("POST", "/v1/jobs", body, {"content-encoding": "gzip"})
            judge(complaints, "members", answer, (413, 422, 429, 503))
        except OSError as error:
            complaints.append(f"members: {error}")

    return together(20, one)


def blocks(stage: Stage) -> list[str]:
    """Four block covariances of 32 x 32 on the large map; the first is to take a second, all are to be answered."""

    def one(number: int, complaints: list[str]) -> None:
        path = f"/v1/maps/{stage.large}/covariance?form=block&i0={90 * number}&j0={90 * number}&ni=32&nj=32&format=npz"
        began = time.monotonic()
        try:
            answer = Connection(stage.port, 120.0).ask("GET", path)
            judge(complaints, f"block after {time.monotonic() - began:.1f} s", answer, (200, 429, 503))
        except OSError as error:
            complaints.append(f"a block: {error}")

    return together(4, one)


def images(stage: Stage) -> list[str]:
    """40 clients that ask for a large picture and leave at once: what nobody waits for is not drawn."""
    before = stage.cpu_seconds()
    for _ in range(40):
        with stage.dial() as wire:
            wire.sendall(message("GET", f"/v1/maps/{stage.large}/image?width=4096&overlay=contour"))
            time.sleep(0.02)
    stage.over.wait(30)
    spent = stage.cpu_seconds() - before
    # Beside other rows it is theirs, too.
    return [f"{spent:.0f} CPU-seconds for nobody"] if stage.alone and spent > MOST_FOR_NOBODY else []


def poison(stage: Stage) -> list[str]:
    """A job of 19,000 scans on ten thousand control points: refused, or stopped soon after it is cancelled."""
    one = rooms.job(5, 0.08)
    scan = one["scans"][0] | {"ranges": one["scans"][0]["ranges"][:20]}
    one["scans"] = [scan | {"pose": scan["pose"] | {"theta": 0.0003 * k}} for k in range(19_000)]
    body = gzip.compress(json.dumps(one).encode())
    connection = Connection(stage.port, 120.0)
    answer = connection.ask("POST", "/v1/jobs", body, {"content-encoding": "gzip"})
    if answer.status != 202:
        return [] if answer.status in (413, 422, 429, 503) else [f"the poison job: {answer.status}"]
    own = f"/v1/jobs/{answer.json()['id']}"
    while connection.ask("GET", own).json()["status"] == "accepted" and not stage.over.is_set():
        time.sleep(0.5)
    stage.over.wait(10)
    status = connection.ask("DELETE", own).status
    return [] if status in (200, 409) else [f"the poison job cannot be cancelled: {status}"]


def fits(stage: Stage) -> list[str]:
    """Two fits of 447 x 447 control points side by side."""
    connection = Connection(stage.port, 120.0)
    for _ in range(2):
        answer = connection.ask("POST", "/v1/jobs", large_job(100))
        if answer.status not in (202, 422, 429, 503):
            return [f"a large fit: {answer.status} {answer.body[:120]!r}"]
    return []


def npy_nests(stage: Stage) -> list[str]:
    """Four questions whose npy header is 40 lists in each other: 180 bytes each. Others must be answered meanwhile."""
    body = npy(HEADER % ("<f8", "False", "[" * 40 + "]" * 40))
    own = f"/v1/maps/{stage.large}/query"

    def one(number: int, complaints: list[str]) -> None:
        connection = Connection(stage.port, 10.0)
        try:
            connection.ask("POST", own, body, {"content-type": NPY})
        except OSError:
            pass

    together(4, one)
    try:
        answer = Connection(stage.port, 20.0).ask("POST", own, {"points": [[1, 1]]})
        return [] if answer.status == 200 else [f"a point is {answer.status} after four nests"]
    except OSError as error:
        return [f"a point is not answered after four nests: {error}"]


def endless_evidence(stage: Stage) -> list[str]:
    """20,000 scans of one beam across 447 x 447 control points, 12 kB packed: evidence is gathered for each over the
    whole lattice. Refused, or given up soon after it is cancelled."""
    side = 444 * 0.02
    scan = {"pose": {"x": -1.0, "y": -1.0, "theta": 0.7853981}, "angle_min": 0.0, "angle_increment": 1e-6}
    scan |= {"range_min": 0.05, "range_max": 100.0, "ranges": [13.9]}
    job = large_job(1) | {"scans": [scan] * 20_000}
    job["map"] |= {"bounds": {"min": [0, 0], "max": [side, side]}}
    body = gzip.compress(json.dumps(job).encode())
    connection = Connection(stage.port, 120.0)
    # As many as there are workers: with none free, nobody's jobs are fitted.
    own = []
    for _ in range(4):
        answer = connection.ask("POST", "/v1/jobs", body, {"content-encoding": "gzip"})
        if answer.status == 202:
            own.append(answer.json()["id"])
    stage.over.wait(10)
    for job_id in own:
        connection.ask("DELETE", f"/v1/jobs/{job_id}")
    after = connection.ask("POST", "/v1/jobs", rooms.job(9, 0.8)).json()
    answer = connection.ask("GET", f"/v1/jobs/{after['id']}?wait=20").json()
    return (
        [] if answer["status"] == "successful" else [f"20 s after its cancellation a small job is {answer['status']}"]
    )


def cold_maps(stage: Stage) -> list[str]:
    """Pictures of, and blocks and points in, two dozen large maps that nobody has loaded, at once: 2 GiB of them."""
    asked = [
        ("GET", "image?width=400", None),
        ("GET", "covariance?form=block&i0=9&j0=9&ni=4&nj=4", None),
        ("POST", "query", {"points": [[1.0, 1.0]]}),
    ]
    seen: list[int] = []

    def one(number: int, complaints: list[str]) -> None:
        method, path, body = asked[number % len(asked)]
        own = f"/v1/maps/{stage.others[number // len(asked)]}/{path}"
        try:
            answer = Connection(stage.port, 120.0).ask(method, own, body)
            judge(complaints, f"{path} of a cold map", answer, (200, 429, 503))
            seen.append(answer.status)
        except OSError as error:
            complaints.append(f"{path} of a cold map: {error}")

    complaints = together(len(asked) * len(stage.others), one)
    if seen.count(200) < len(stage.others):
        complaints.append(f"{seen.count(200)} of {len(seen)} were answered")
    return complaints


def lost_scans(stage: Stage) -> list[str]:
    """60 questions of some kilobytes where 1,000 scans of 9,000 beams were taken: they wait for the one who is at it."""
    scan = {"angle_min": 0.0, "angle_increment": 0.0005, "range_min": 0.05, "range_max": 30.0, "pose": None}
    scan |= {"ranges": [2] * 9_000}
    noise = rooms.job(1)["noise"]
    body = gzip.compress(json.dumps({"scans": [scan] * 1_000, "noise": noise}).encode(), 9)

    def one(_: int, complaints: list[str]) -> None:
        try:
            own = f"/v1/maps/{stage.large}/localize"
            answer = Connection(stage.port, 120.0).ask("POST", own, body, {"content-encoding": "gzip"})
            judge(complaints, "lost scans", answer, (200, 413, 422, 429, 503))
        except OSError as error:
            complaints.append(f"lost scans: {error}")

    return together(60, one)
