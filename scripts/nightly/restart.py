#!/usr/bin/env python3
"""How soon a service with 10,000 jobs and their maps is ready again after kill -9.

    scripts/nightly/restart.py --binary target/release/mapfit

A few jobs are fitted; their rows and their maps' files are then copied, each under ids of its own, until there are as
many as are asked for: fitting them would take an hour and leave the same behind. The service is started on them, given
jobs that keep its workers busy, killed, and started again, several times. Ready is `/readyz`; then one of all maps is
asked a question.
Exit code 1 where a start takes longer than 2 s, or a map is not there.
"""

import argparse
import json
import random
import shutil
import sqlite3
import statistics
import sys
import tempfile
import time
from pathlib import Path

from jobs import rooms
from service.bar import Bar
from service.copies import copy_job, copy_map, maps_of, new_id
from service.process import Server

WITHIN = 2.0
# Jobs that are fitted, and then copied.
FITTED = 20
# Beside those with maps, as many that wait.
WAITING = 500


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", default="target/release/mapfit")
    parser.add_argument("--jobs", type=int, default=10_000)
    parser.add_argument("--kills", type=int, default=5)
    parser.add_argument("--json", type=Path, help="write a report there")
    return parser.parse_args()


def fitted(server: Server) -> None:
    """A few real jobs and maps; the service ends in peace, so that its database is one file."""
    server.start()
    server.until_ready()
    connection = server.connection(120.0)
    ids = [connection.ask("POST", "/v1/jobs", rooms.job(seed, 0.3)).json()["id"] for seed in range(FITTED)]
    for job in ids:
        state = connection.ask("GET", f"/v1/jobs/{job}?wait=60").json()
        if state["status"] != "successful":
            raise RuntimeError(f"a job to copy is {state['status']}")
    if not server.terminate():
        raise RuntimeError("the server does not end")


def copied(data: Path, jobs: int) -> list[str]:
    """Copies rows and files until there are so many jobs with maps; the ids of all maps."""
    database = sqlite3.connect(data / "mapfit.sqlite")
    originals = maps_of(database)
    maps = [row["map"] for row in originals]
    bar = Bar("copies", jobs + WAITING)
    for k in range(jobs + WAITING - len(originals)):
        original = originals[k % len(originals)]
        if k < WAITING:
            waiting = {"id": new_id(k), "map_id": None, "status": "accepted", "attempt": 0}
            copy_job(database, original["job"], waiting | {"started": None, "finished": None})
        else:
            maps.append(copy_map(database, data / "artifacts", original, k, shutil.copy))
        bar.at(k)
    database.commit()
    database.close()
    bar.end()
    return maps


def starts(server: Server, maps: list[str], kills: int) -> tuple[list[float], list[str]]:
    """Seconds that each start took until it was ready, and what was wrong."""
    times, faults, draw = [], [], random.Random(1)
    server.start()
    server.until_ready()
    for _ in range(kills):
        # So that there is a journal to be read, and running jobs to be taken up again.
        connection = server.connection()
        for seed in range(200):
            connection.ask("POST", "/v1/jobs", rooms.job(seed, 0.3))
        time.sleep(1.0)
        connection.close()
        server.kill()
        began = time.monotonic()
        server.start()
        server.until_ready()
        times.append(time.monotonic() - began)
        asked = draw.choice(maps)
        answer = server.connection().ask("POST", f"/v1/maps/{asked}/query", {"points": [[1, 1]]})
        if answer.status != 200:
            faults.append(f"map {asked}: {answer.status} {answer.body[:200]!r}")
    count = len(server.connection(60.0).pages("/v1/maps"))
    if count < len(maps):
        faults.append(f"{count} maps of {len(maps)} are there")
    return times, faults


def main() -> int:
    options = arguments()
    folder = Path(tempfile.mkdtemp(prefix="mapfit-restart-"))
    server = Server(options.binary, folder / "data", 2)
    try:
        fitted(server)
        maps = copied(server.data, options.jobs)
        times, faults = starts(server, maps, options.kills)
    finally:
        server.kill()
        shutil.rmtree(folder)
    report = {
        "jobs": options.jobs,
        "maps": len(maps),
        "median_s": round(statistics.median(times), 3),
        "slowest_s": round(max(times), 3),
        "faults": faults,
    }
    print(json.dumps(report))
    if max(times) > WITHIN:
        print(f"missed: ready after {max(times):.2f} s, bar {WITHIN:g}")
    if options.json:
        options.json.write_text(json.dumps(report, indent=2))
    return 1 if faults or max(times) > WITHIN else 0


if __name__ == "__main__":
    sys.exit(main())
