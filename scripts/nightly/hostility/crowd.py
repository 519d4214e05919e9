"""The table's rows in 2 GiB: each alone, then all at once, while an ordinary client works.

The bars: the process lives and is not killed for its memory, /livez p99 50 ms, POST /v1/jobs p99 1 s, every small job
of the ordinary client successful, and the process ends by itself after SIGTERM.
"""

import argparse
import os
import resource
import shutil
import sqlite3
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from service.bar import Bar
from service.cgroup import MemoryLimit
from service.copies import copy_map, maps_of
from service.process import Server

from .ordinary import Ordinary
from .rows import BEYOND, ROWS
from .stage import Stage, large_job

MEMORY = 2 << 30
LIVEZ_P99_MS = 50.0
POST_P99_MS = 1000.0
# Three may be busy with what is large; one is left for others.
WORKERS = 4
# Of the large map.
COPIES = 24


def run(options: argparse.Namespace, folder: Path) -> Iterator[tuple[str, dict]]:
    """A report a row, and one for all together."""
    # Thousands of connections, here and, as children inherit it, there.
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 20_000), hard))
    data, large = _with_large_map(options, folder)
    others = _with_copies(data)
    chosen = options.rows.split(",") if options.rows else [*ROWS, *BEYOND, "all"]
    for name in ["quiet", *chosen]:
        rows = {"quiet": [], "all": list(ROWS)}.get(name, [name])
        yield name, _scene(options, folder, data, (large, others), name, rows)


def _with_large_map(options: argparse.Namespace, folder: Path) -> tuple[Path, str]:
    """A data folder with a map of 447 x 447 control points, made without a limit."""
    server = Server(options.binary, folder / "prepared", 1, options.server_args.split())
    server.start()
    try:
        server.until_ready()
        connection = server.connection(120.0)
        job = connection.ask("POST", "/v1/jobs", large_job(2)).json()
        while job["status"] in ("accepted", "running"):
            job = connection.ask("GET", f"/v1/jobs/{job['id']}?wait=20").json()
        if not job["map_id"]:
            raise RuntimeError(f"the large map was not made: {job['problem']}")
        server.terminate()
        return server.data, job["map_id"]
    finally:
        server.kill()


def _with_copies(data: Path) -> list[str]:
    """Copies of the large map in the same folder; their files are the same."""
    database = sqlite3.connect(data / "mapfit.sqlite")
    original = maps_of(database)[0]
    ids = [copy_map(database, data / "artifacts", original, number, os.link) for number in range(COPIES)]
    database.commit()
    database.close()
    return ids


def _linked(source: str, target: str) -> None:
    """A copy of a file: an artifact is never written over."""
    (os.link if source.endswith(".npz") else shutil.copy2)(source, target)


Maps = tuple[str, list[str]]


def _scene(options: argparse.Namespace, folder: Path, data: Path, maps: Maps, name: str, rows: list[str]) -> dict:
    """Some rows against a fresh server on a copy of the data."""
    own = folder / f"row-{name}"
    shutil.copytree(data, own, copy_function=_linked)
    limit = MemoryLimit(MEMORY, f"mapfit-{name}")
    server = Server(options.binary, own, WORKERS, options.server_args.split(), enter=limit.enter)
    server.start()
    limit.watch(server)
    failures: list[str] = []
    try:
        server.until_ready()
        seen, failures = _crowd(options, server, maps, name, rows)
        peak = server.peak_memory()
        alive = server.alive()
        if alive and not server.terminate(30.0):
            failures.append("the process does not end within 30 s of SIGTERM")
    finally:
        server.kill()
        killed = limit.killed()
        limit.remove()
        shutil.rmtree(own)
    if killed:
        failures.insert(0, f"killed: more than {MEMORY >> 20} MiB")
    elif not alive:
        failures.insert(0, f"the process ended ({server.child.returncode})")
    failures += [f"a panic: {panic[:200]}" for panic in server.panics()]
    failures += _bars(seen)
    return {"limit": limit.kind, "peak_mib": peak >> 20, **seen, "failures": failures}


def _crowd(
    options: argparse.Namespace, server: Server, maps: Maps, name: str, rows: list[str]
) -> tuple[dict, list[str]]:
    """Lets the rows loose for a while; what the ordinary client saw, and what the rows complain of."""
    stage = Stage(server.port, *maps, threading.Event(), server.cpu_seconds, len(rows) == 1)
    complaints: list[str] = []

    def act(row: str) -> None:
        try:
            complaints.extend(f"{row}: {found}" for found in ({**ROWS, **BEYOND})[row](stage))
        except OSError as error:
            complaints.append(f"{row}: {error}")

    ordinary = Ordinary(server.port, patience=120.0)
    time.sleep(2)
    threads = [threading.Thread(target=act, args=(row,), daemon=True) for row in rows]
    for thread in threads:
        thread.start()
    seconds = options.seconds if rows else 20.0
    bar, began = Bar(f"row {name}", int(seconds)), time.monotonic()
    while (lasted := time.monotonic() - began) < seconds and server.alive():
        bar.at(int(lasted), f"{server.memory() >> 20} MiB")
        time.sleep(0.5)
    bar.end()
    stage.over.set()
    if not server.alive():
        complaints.append(f"it lived for {lasted:.0f} s")
    for thread in threads:
        thread.join(130)
    return ordinary.stop(), complaints


def _bars(seen: dict) -> list[str]:
    """Which bars the ordinary client saw broken."""
    broken = []
    if (seen["livez_p99_ms"] or 0) > LIVEZ_P99_MS:
        broken.append(f"/livez p99 is {seen['livez_p99_ms']} ms, bar {LIVEZ_P99_MS:.0f}")
    if (seen["post_p99_ms"] or 0) > POST_P99_MS:
        broken.append(f"POST /v1/jobs p99 is {seen['post_p99_ms']} ms, bar {POST_P99_MS:.0f}")
    if seen["successful"] < seen["posts"]:
        broken.append(f"{seen['posts'] - seen['successful']} of {seen['posts']} ordinary jobs did not succeed")
    troubles = seen.pop("troubles")
    if troubles:
        broken.append(f"{len(troubles)} troubles of the ordinary client, the first: {troubles[0]}")
    return broken
