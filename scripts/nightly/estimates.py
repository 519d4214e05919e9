#!/usr/bin/env python3
"""Is what `dry_run` says within a factor of two of what a job takes?

    MAPFIT_RECORDINGS=../shared/data scripts/nightly/estimates.py --binary target/release/mapfit

Real logs and simulated rooms, of both distances, at several resolutions and densities of scans. Each is asked about,
then fitted by a server of its own with one worker: the seconds are the fit's, the bytes the server's peak beyond what it
held idle. Seconds hold for the machine whose fits the constants are from (`src/map/cost.rs`), with nothing beside it.
Exit code 1 where a ratio is out of [1/2, 2].
"""

import argparse
import json
import os
import sys
import tempfile
from pathlib import Path

from jobs import rooms
from service.bar import Bar
from service.process import Server

BOUNDARY = "mapfit-estimates"
# Log, every so many scans, distance, resolution.
LOGS = [
    ("seattle", 1, "vdf", 0.2),
    ("seattle", 1, "vdf", 0.1),
    ("seattle", 4, "vdf", 0.25),
    ("seattle", 1, "sdf", 0.25),
    ("intel", 1, "vdf", 0.25),
    ("intel", 1, "vdf", 0.15),
    ("intel", 5, "vdf", 0.2),
    ("intel", 5, "sdf", 0.25),
    ("freiburg-079", 8, "vdf", 0.2),
    ("freiburg-079", 4, "vdf", 0.3),
]
# Distance, resolution, beams a scan.
ROOMS = [("sdf", 0.1, 181), ("sdf", 0.05, 361), ("vdf", 0.1, 181), ("vdf", 0.05, 361)]


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", default="target/release/mapfit")
    parser.add_argument("--only", default="", help="the cases whose names contain this")
    parser.add_argument("--json", type=Path, help="write a report there")
    return parser.parse_args()


def recording(log: Path, options: dict) -> tuple[bytes, dict]:
    """A request of a log and its options."""
    parts = [("options", "options.json", json.dumps(options).encode()), ("recording", log.name, log.read_bytes())]
    body = b"".join(
        f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="{name}"; filename="{file}"\r\n\r\n'.encode()
        + content
        + b"\r\n"
        for name, file, content in parts
    )
    return body + f"--{BOUNDARY}--\r\n".encode(), {"content-type": f"multipart/form-data; boundary={BOUNDARY}"}


def cases() -> list[tuple[str, object, dict]]:
    """Names, bodies, headers."""
    folder = Path(os.environ["MAPFIT_RECORDINGS"])
    noise = {"sigma_x": 0.02, "sigma_y": 0.02, "sigma_theta": 0.005, "sigma_range": 0.02}
    found = []
    for log, every, distance, resolution in LOGS:
        options = {"noise": noise, "map": {"distance": distance, "resolution": resolution}, "every": every}
        body, headers = recording(folder / f"{log}.flaser.log.gz", options)
        found.append((f"{log}, every {every}., {distance}, {resolution} m", body, headers))
    for distance, resolution, beams in ROOMS:
        found.append((f"room, {beams} beams, {distance}, {resolution} m", rooms.job(1, resolution, distance, beams), {}))
    return found


def measured(binary: str, folder: Path, body: object, headers: dict) -> dict:
    """What was said, and what it took."""
    server = Server(binary, folder / "data", 1)
    server.start()
    server.until_ready()
    try:
        connection = server.connection(1800.0)
        said = connection.ask("POST", "/v1/jobs?dry_run=true", body, headers)
        if said.status != 200:
            raise RuntimeError(f"dry_run: {said.status} {said.body[:500]}")
        said = said.json()
        idle = server.peak_memory()
        job = connection.ask("POST", "/v1/jobs", body, headers).json()["id"]
        while (state := connection.ask("GET", f"/v1/jobs/{job}?wait=60").json())["status"] in ("accepted", "running"):
            pass
        if state["status"] != "successful":
            raise RuntimeError(f"{state['status']}: {state['problem']}")
        fit = connection.ask("GET", f"/v1/maps/{state['map_id']}").json()["fit"]
        return {
            "control_points": said["control_points"],
            "said": said["estimate"],
            "seconds": fit["seconds"],
            "bytes": server.peak_memory() - idle,
        }
    finally:
        server.terminate()


def main() -> int:
    args = arguments()
    rows = []
    wanted = [case for case in cases() if args.only in case[0]]
    bar = Bar("fits", len(wanted))
    for name, body, headers in wanted:
        bar.at(len(rows), name)
        with tempfile.TemporaryDirectory(prefix="mapfit-estimates-") as folder:
            rows.append({"case": name, **measured(args.binary, Path(folder), body, headers)})
    bar.end()
    for row in rows:
        row["time"] = row["said"]["seconds"] / row["seconds"]
        row["memory"] = row["said"]["bytes"] / row["bytes"]
    bad = 0
    for row in rows:
        good = 0.5 <= row["time"] <= 2 and 0.5 <= row["memory"] <= 2
        bad += not good
        print(
            f"{'ok ' if good else 'BAD'} {row['case']:40} {row['control_points']:7} control points"
            f"  {row['seconds']:7.2f} s, said over taken {row['time']:.2f}"
            f"  {row['bytes'] / 1e6:6.0f} MB, {row['memory']:.2f}"
        )
    print(f"{bad} of {len(rows)} are off by more than a factor of two")
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1))
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
