"""A robot's recordings before the service and the command line. Arguments: url, the mapfit binary, a CARMEN log.

The same log as CARMEN and as MCAP gives the same map; what is odd gives a map, or a message that says what to do."""

import gzip
import io
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import httpx
import numpy as np
from mcap.writer import CompressionType
from recorded import (
    PERIOD,
    SECOND,
    START,
    bomb,
    log_lines,
    nothing_in_it,
    recording,
    rewritten,
)

url, mapfit, log = sys.argv[1:4]
folder = Path(tempfile.mkdtemp())
http = httpx.Client(base_url=url, timeout=120, trust_env=False)
texts, lines = log_lines(Path(log), 48)
few = lines[:16]
NOISE = {"sigma_x": 0.02, "sigma_y": 0.02, "sigma_theta": 0.005, "sigma_range": 0.02}
JOB = {"noise": NOISE, "map": {"distance": "vdf", "resolution": 0.5}}


def post(data: bytes, options: dict | None = None, query="", headers=None, **more) -> httpx.Response:
    files = {"recording": ("drive.mcap", data), "options": ("options", json.dumps({**JOB, **(options or {})}), "application/json")}
    return http.post(f"/v1/jobs{query}", files={**files, **more}, headers=headers)


def map_of(answer: httpx.Response) -> np.lib.npyio.NpzFile:
    assert answer.status_code == 202, answer.text
    job = answer.json()
    while job["status"] not in ("successful", "failed", "dismissed"):
        job = http.get(f"/v1/jobs/{job['id']}?wait=20").json()
    assert job["status"] == "successful", job
    return np.load(io.BytesIO(http.get(f"/v1/maps/{job['map_id']}/coefficients?format=npz").content))


def apart(a, b) -> float:
    assert a["vdf_x"].shape == b["vdf_x"].shape, (a["vdf_x"].shape, b["vdf_x"].shape)
    both = [np.nan_to_num(m[name], nan=1e9) for name in ("vdf_x", "vdf_y") for m in (a, b)]
    return max(np.abs(both[0] - both[1]).max(), np.abs(both[2] - both[3]).max())


def refused(answer: httpx.Response, status: int, *words: str, pointer=None):
    assert answer.status_code == status, (answer.status_code, answer.text)
    problem = answer.json()
    assert answer.headers["content-type"] == "application/problem+json"
    for word in words:
        assert word in problem["detail"] or any(word in e["detail"] for e in problem.get("errors", [])), (word, problem)
    if pointer is not None:
        assert pointer in [e["pointer"] for e in problem["errors"]], problem


def cli(*arguments: str, file: bytes, name="drive.mcap", **environment) -> subprocess.CompletedProcess:
    path = folder / name
    path.write_bytes(file)
    command = [mapfit, arguments[0], str(path), *arguments[1:]]
    known = {"PATH": os.environ["PATH"], "MAPFIT_URL": url}
    return subprocess.run(command, capture_output=True, text=True, env={**known, **environment}, timeout=120)


# The same log, three ways in: CARMEN, MCAP over HTTP, MCAP on the command line.
carmen = "\n".join(texts).encode() + b"\n"
good = recording(lines)
reference = map_of(post(carmen))
distance = apart(reference, map_of(post(good)))
print(f"CARMEN and MCAP: coefficients differ by {distance:.1e} m at most")
assert distance < 1e-9
said = cli("submit", "--wait", "--json", "--resolution", "0.5", file=good)
assert said.returncode in (0, 1), said.stderr
made = json.loads(said.stdout)["map"]
own = np.load(io.BytesIO(http.get(f"/v1/maps/{made['id']}/coefficients?format=npz").content))
assert apart(reference, own) < 1e-9 and made["distance"] == "vdf" and made["name"] == "drive"
out = folder / "out"
said = cli("fit", "--out", str(out), "--resolution", "0.5", file=good)
assert said.returncode == 0, said.stderr
assert apart(reference, np.load(out / "coefficients.npz")) < 1e-9
said = cli("fit", "--out", str(out), "--resolution", "0.5", file=gzip.compress(carmen), name="drive.log.gz")
assert said.returncode == 0 and apart(reference, np.load(out / "coefficients.npz")) < 1e-9, said.stderr

# Other ways to write the same down.
reference = map_of(post("\n".join(texts[:16]).encode()))
same = {
    "lz4": recording(few, compression=CompressionType.LZ4),
    "no compression": recording(few, compression=CompressionType.NONE),
    "no chunks": rewritten(recording(few), chunked=False),
    "gzipped": gzip.compress(recording(few)),
    "odometry": recording(few, poses="odometry"),
    "a pose topic": recording(few, poses="posed"),
    "first echoes": recording(few, echoes=True),
}
for name, data in same.items():
    distance = apart(reference, map_of(post(data)))
    assert distance < 1e-9, (name, distance)

# Beams the other way round are added up in another order: the same map, but not to the last bits.
distance = apart(reference, map_of(post(recording(few, head_down=True))))
assert distance < 1e-4, distance

# Covariances come with the poses, carried to the scanner.
covariance = [0.0] * 36
covariance[0], covariance[7], covariance[35] = 4e-4, 1e-4, 2.5e-5
job = post(recording(few, poses="posed", covariance=covariance)).json()
scan = http.get(f"/v1/jobs/{job['id']}/request").json()["scans"][3]
theta = scan["pose"]["theta"]
lever = 0.25 * np.array([np.cos(theta), np.sin(theta)])
jacobian = np.array([[1, 0, -lever[1]], [0, 1, lever[0]], [0, 0, 1]])
expected = jacobian @ np.diag([4e-4, 1e-4, 2.5e-5]) @ jacobian.T
assert np.allclose(np.reshape(scan["pose_covariance"], (3, 3)), expected, rtol=0, atol=1e-15)
assert scan["ranges"] == [None if r > 50 else r for r in few[3].ranges]

# A robot that moves while its beams go round: whole beams, in parts, each from where the robot was; a job says so.
job = post(recording(few, time_increment=0.1 / 360)).json()
parts = http.get(f"/v1/jobs/{job['id']}/request").json()["scans"]
assert "in parts" in job["message"] and "1 of 16 scans are left out" in job["message"], job["message"]
assert sum(len(s["ranges"]) for s in parts) == 15 * len(few[0].ranges) and len(parts) > 15
steps = [np.hypot(b["pose"]["x"] - a["pose"]["x"], b["pose"]["y"] - a["pose"]["y"]) for a, b in zip(parts, parts[1:])]
assert np.median(steps) < 0.03

# Which scans are taken.
some = {"every": 3, "from": 1, "to": 12, "name": "part", "labels": {"site": "hq"}}
job = post(recording(few), some).json()
request = http.get(f"/v1/jobs/{job['id']}/request").json()
assert [s["pose"]["x"] for s in request["scans"]] == [few[k].pose[0] for k in (1, 4, 7, 10)] or np.allclose(
    [s["pose"]["x"] for s in request["scans"]], [few[k].pose[0] for k in (1, 4, 7, 10)], rtol=0, atol=1e-12
)
assert (request["name"], request["labels"]) == ("part", {"site": "hq"}) and "every" not in request
dry = post(recording(few), query="?dry_run=true").json()
assert dry["scans"] == 16 and dry["estimate"]["bytes"] > 0
# What only the service reads is shown: where the scans lie.
assert np.abs(np.array(dry["preview"]["poses"]) - [scan.pose[:2] for scan in few]).max() <= 6e-4
assert len(dry["preview"]["returns"]) == min(dry["returns"], 20_000)
keyed = {"idempotency-key": "drive-1"}
first = post(recording(few), headers=keyed)
again = post(recording(few), headers=keyed)
assert (first.status_code, again.status_code) == (202, 200) and first.json()["id"] == again.json()["id"]
refused(post(recording(few), {"every": 2}, headers=keyed), 422)

# Odd ones. Two lasers, then one of them; time that goes back; a jump of all clocks.
two = recording(few, scan_topics=("/front/scan", "/rear/scan"))
refused(post(two), 422, "/front/scan", "/rear/scan", "scan_topic", pointer="/scan_topic")
assert apart(reference, map_of(post(two, {"scan_topic": "/rear/scan"}))) < 1e-9
refused(post(two, {"scan_topic": "/scan"}), 422, "/front/scan", pointer="/scan_topic")
listed = cli("submit", "--list", file=two)
assert listed.returncode == 0 and "/front/scan" in listed.stdout and "base_link -> laser (fixed)" in listed.stdout
chosen = cli("submit", "--scan-topic", "/rear/scan", "--pose-topic", "base_link", "--resolution", "0.5", file=two)
assert chosen.returncode == 0, chosen.stderr
said = cli("submit", file=two)
assert said.returncode == 2 and "--scan-topic" in said.stderr
back = recording(few, at=lambda k: START + (k if k < 10 else k - 10) * PERIOD + (0 if k < 10 else -100 * SECOND))
answer = post(back)
assert "time goes back at scan 10" in answer.json()["message"], answer.text
assert apart(reference, map_of(answer)) < 1e-9
jump = recording(few, at=lambda k: START + k * PERIOD + (0 if k < 10 else 3600 * SECOND))
assert apart(reference, map_of(post(jump))) < 1e-9

# What cannot become a map says what to do.
whole = recording(few)
refused(post(recording(few, poses="none", static=False)), 422, "/scan", "laser", "Record /tf", pointer="/recording")
refused(post(recording(few, shift=3600 * SECOND)), 422, "two clocks", pointer="/recording")
refused(post(rewritten(whole, "ros1")), 422, "ros1", "rosbags-convert")
refused(post(rewritten(whole, "json")), 422, "json", "cdr")
refused(post(rewritten(whole, "protobuf")), 422, "protobuf")
refused(post(whole[: len(whole) // 2]), 422, "mcap recover")
refused(post(b""), 422, "empty")
refused(post(nothing_in_it()), 422, "no laser scans")
refused(post(bomb(1 << 62)), 413, "the limit is")
refused(post(recording(few, static=False)), 422, "'map'".strip("'"), "laser", "/tf_static")
refused(post(recording(few, poses="odometry", static=False)), 422, "base_link", "laser", "/tf_static")
refused(post(b"#ROSBAG V2.0\n" + bytes(100)), 422, "ROS 1", "rosbags-convert")
refused(post(b"P5\n2 2\n255\n\0\0\0\0"), 422, "picture", "evidence")
refused(post(b"image: map.pgm\nmode: trinary\n"), 422, "picture")
refused(post(bytes(range(256)) * 10), 422, "neither")
damaged = bytearray(whole)
damaged[len(whole) // 2] ^= 0x55
refused(post(bytes(damaged)), 422, "damaged")
refused(post(whole, {"from": 99}), 422, "none of", pointer="/from")
said = cli("submit", file=whole[: len(whole) // 2])
assert said.returncode == 2 and "mcap recover" in said.stderr

# Faults of the options point into them, all at once, before the recording is looked at.
bad = {"noise": {**NOISE, "sigma_x": -1}, "every": 0, "colour": 1, "scan_topic": 7, "scans": []}
answer = post(b"", bad)
refused(answer, 422)
pointers = {e["pointer"] for e in answer.json()["errors"]}
assert {"/noise/sigma_x", "/every", "/colour", "/scan_topic", "/scans"} <= pointers, pointers
refused(post(whole, {"noise": None}), 422, pointer="/noise")
refused(post(whole, extra=("x", b"1")), 422, pointer="/extra")
refused(http.post("/v1/jobs", files={"recording": ("a", whole)}), 422, pointer="/options")
refused(http.post("/v1/jobs", files={"options": ("a", b"{}")}), 422, pointer="/recording")
refused(http.post("/v1/jobs", content=b"x", headers={"content-type": "multipart/form-data"}), 400, "boundary")
refused(
    http.post("/v1/jobs", content=b"--B\r\n", headers={"content-type": "multipart/form-data; boundary=B"}), 400, "headers"
)
refused(http.post("/v1/jobs", files={"recording": ("a", whole), "options": ("o", b"{")}), 400)
print("every recording gives a map or a message")
