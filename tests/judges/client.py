"""A client generated from the OpenAPI document by openapi-python-client, used against the service. Argument: base URL.

Whoever writes a client starts from the document: it must generate without a warning, have every operation, and carry a
job from its submission to its map.
"""

import importlib
import json
import math
import subprocess
import sys
import tempfile
import urllib.request
from pathlib import Path

base = sys.argv[1].rstrip("/")
with urllib.request.urlopen(f"{base}/openapi.json") as answer:
    document = json.load(answer)
operations = [
    o for item in document["paths"].values() for o in item.values() if isinstance(o, dict) and "operationId" in o
]

# The generator knows JSON, text and bytes by their names alone, whatever the schema; these media types are bytes.
BYTES = [
    "application/x-npz",
    "application/x-npy",
    "application/x-mcap",
    "application/zip",
    "image/png",
    "image/svg+xml",
    "image/tiff",
]
OPTIONS = {"content_type_overrides": {name: "application/octet-stream" for name in BYTES}, "post_hooks": []}

with tempfile.TemporaryDirectory() as folder:
    here = Path(folder)
    (here / "openapi.json").write_text(json.dumps(document))
    (here / "options.json").write_text(json.dumps(OPTIONS))
    arguments = (
        "generate --path openapi.json --config options.json --meta none --output-path generated --fail-on-warning"
    )
    command = [sys.executable, "-m", "openapi_python_client", *arguments.split()]
    made = subprocess.run(command, cwd=here, capture_output=True, text=True)
    said = made.stdout + made.stderr
    assert made.returncode == 0 and "WARNING" not in said and "ERROR" not in said, said
    sys.path.insert(0, folder)
    calls = {
        o["operationId"]: importlib.import_module(f"generated.api.{o['tags'][0]}.{o['operationId']}")
        for o in operations
    }
    models = importlib.import_module("generated.models")
    client = importlib.import_module("generated").Client(base_url=base)


called = set()


def call(name, status, *arguments, **parameters):
    """An operation's answer, in the type the document gives it."""
    called.add(name)
    answer = calls[name].sync_detailed(*arguments, client=client, **parameters)
    assert answer.status_code == status, (name, answer.status_code, answer.content)
    return answer.parsed


# A room of 4 m by 4 m, seen from its middle.
BEAMS = 60
bearings = [2 * math.pi * k / BEAMS - math.pi for k in range(BEAMS)]
scan = models.Scan(
    pose=models.Pose(x=0.0, y=0.0, theta=0.0),
    angle_min=-math.pi,
    angle_increment=2 * math.pi / BEAMS,
    range_min=0.05,
    range_max=30.0,
    ranges=[2 / max(abs(math.cos(b)), abs(math.sin(b))) for b in bearings],
)
wanted = models.JobRequest.from_dict(
    {
        "name": "a generated client's",
        "scans": [scan.to_dict()],
        "noise": {"sigma_x": 0.01, "sigma_y": 0.01, "sigma_theta": 0.005, "sigma_range": 0.02},
        "map": {"distance": "sdf", "resolution": 0.5},
    }
)


def ended(job):
    """The job as it stands when it is over."""
    while job.status in (models.JobStatus.ACCEPTED, models.JobStatus.RUNNING):
        job = call("get_job", 200, job.id, wait=4.0)
    return job


job = call("submit_job", 202, body=wanted)
assert isinstance(job, models.Job) and job.name == wanted.name
job = ended(job)
assert job.status == models.JobStatus.SUCCESSFUL and job.progress.percent == 100, job

record = call("get_map", 200, job.map_id)
assert record.distance == "sdf" and str(record.job_id) == str(job.id) and record.fit.converged
nx, ny = record.lattice.control_points

answer = call("query_map", 200, job.map_id, body=models.QueryBody(points=[[0.0, 1.5], [9.0, 9.0]]))
assert abs(answer.distance[0] + 0.5) < 0.1 and 0 < answer.sigma[0] < 0.1, answer
assert answer.distance[1] is None and answer.sigma[1] is None, answer

assert str(job.map_id) in [str(listed.id) for listed in call("list_maps", 200, limit=5).items]
coefficients = call("get_map_coefficients", 200, job.map_id)
assert len(coefficients.sdf) == nx * ny and coefficients.lattice == record.lattice

# Where was this scan taken, if all one knows is that it was near the middle? And a map of both scans together.
sighting = models.SightedScan.from_dict({**scan.to_dict(), "pose": {"x": 0.02, "y": -0.02, "theta": 0.01}})
noise = models.Noise.from_dict({**wanted.noise.to_dict(), "sigma_x": 0.1, "sigma_y": 0.1})
found = call("localize_scans", 200, job.map_id, body=models.LocalizeBody(scans=[sighting], noise=noise)).poses[0]
assert found.converged and math.hypot(found.pose.x, found.pose.y) < 0.05, found
grown = ended(call("update_map", 202, job.map_id, body=models.UpdateRequest(scans=[scan], noise=wanted.noise)))
newer = call("get_map", 200, grown.map_id)
assert newer.version == 2 and str(newer.parent) == str(job.map_id), newer

# Two maps whose frames are the same become one, which knows where each of them lies.
held = {"id": str(job.map_id), "pose": {"x": 0, "y": 0, "theta": 0}}
other = {**held, "id": str(grown.map_id), "pose_covariance": [1e-4, 0, 0, 0, 1e-4, 0, 0, 0, 1e-4]}
joined = ended(
    call("join_maps", 202, body=models.JoinRequest.from_dict({"maps": [held, other], "map": {"resolution": 0.5}}))
)
frames = call("get_map_frames", 200, joined.map_id).frames
assert [str(frame.map_id) for frame in frames] == [held["id"], other["id"]], frames

place = call("publish_map", 201, "hall", body=models.NewVersion(map_id=job.map_id, note="first"))
assert (place.name, place.version, str(place.map_id)) == ("hall", 1, str(job.map_id)), place
call("publish_map", 200, "hall", body=models.NewVersion(map_id=grown.map_id, note="second"))
back = call("roll_back_place", 200, "hall", body=models.Rollback(version=1))
assert (back.version, str(back.map_id)) == (3, str(job.map_id)), back
call("ask_place_map", 307, "hall", "query")
hook = call(
    "add_webhook", 201, body=models.NewWebhook(url="https://hooks.example/", events=[models.Event.JOB_SUCCESSFUL])
)
relabelling = models.Relabelling.from_dict({"labels": {"site": "hq"}})
for relabelled in (
    call("relabel_map", 200, job.map_id, body=relabelling),
    call("relabel_job", 200, job.id, body=relabelling),
):
    assert relabelled.labels["site"] == "hq" and relabelled.name == wanted.name
again = call("retry_job", 202, job.id)
assert str(again.retry_of) == str(job.id)
ended(again)

# A fit of seconds, given up as soon as it was asked for. One that has ended can only be forgotten, without its map.
fine = models.JobRequest.from_dict({**wanted.to_dict(), "map": {"distance": "sdf", "resolution": 0.02}})
given_up = call("cancel_job", 200, call("submit_job", 202, body=fine).id)
assert given_up.status == models.JobStatus.DISMISSED, given_up
assert isinstance(call("cancel_job", 409, job.id), models.Problem)

# Every other reading, too, comes in a type of the document; a place's map is elsewhere.
known = {"name": "hall", "part": "poses", "layer": "distance", "z": 7, "x": 0, "y": 0}
own = {"jobs": job.id, "maps": job.map_id, "webhooks": hook.id}
for path, item in document["paths"].items():
    parts = [part.strip("{}") for part in path.split("/") if part.startswith("{")]
    ids = [own[path.split("/")[2]] if part == "id" else known[part] for part in parts]
    if "get" in item:
        status = 307 if "307" in item["get"]["responses"] else 200
        asked = {"since": str(job.map_id)} if path.endswith("/changes") else {}
        assert call(item["get"]["operationId"], status, *ids, **asked) is not None or status == 307, path

call("delete_map", 409, job.map_id)
call("remove_place", 204, "hall")
call("remove_webhook", 204, hook.id)
call("delete_map", 204, job.map_id)
gone = call("get_map", 404, job.map_id)
assert isinstance(gone, models.Problem) and gone.status == 404
call("cancel_job", 204, job.id, purge=True)

documented = {o["operationId"] for o in operations}
assert called == documented, f"not called: {sorted(documented - called)}; not documented: {sorted(called - documented)}"
print(
    f"all {len(documented)} operations generated and called: jobs, maps, places, webhooks and the service as documented"
)
