"""Mutated jobs, run to their end, and mutated questions to the maps that come of them."""

import argparse
import json
import queue
import random
import threading
import time
from collections import Counter
from collections.abc import Callable
from functools import partial

from jobs.mutations import WILD, mutated
from service.bar import Bar
from service.connection import Answer, Connection
from service.process import Server

from .verdict import Verdicts

# A job that has not ended by then, its time in the queue included, is lost, seconds.
LOST_AFTER = 600.0
THREADS = 4
ENDED = ("successful", "failed", "dismissed")
# What a job may fail with that is the job's own fault.
HONEST = ("ill-determined", "no-evidence", "fit-failed", "too-expensive", "deadline-exceeded")


def run(server: Server, verdicts: Verdicts, options: argparse.Namespace) -> int:
    """Sends mutated jobs; how many that were."""
    seed, count = options.seed, options.mutations
    waiting: queue.Queue[int] = queue.Queue()
    for number in range(seed, seed + count):
        waiting.put(number)
    ends: Counter[str] = Counter()
    threads = [
        threading.Thread(target=_work, args=(server, verdicts, waiting, ends, options.longest)) for _ in range(THREADS)
    ]
    for thread in threads:
        thread.start()
    bar = Bar("mutants", count)
    while any(thread.is_alive() for thread in threads):
        bar.at(count - waiting.qsize(), f"{dict(ends)}, {server.memory() >> 20} MiB, {len(verdicts.failures)} failures")
        time.sleep(0.2)
        if not server.alive():
            verdicts.fail(
                f"the process has ended ({server.child.returncode}) at about mutant {seed + count - waiting.qsize()}"
            )
            server.start()
            server.until_ready()
    bar.end()
    verdicts.figures["ends"] = dict(ends)
    return count


def _work(server: Server, verdicts: Verdicts, waiting: queue.Queue, ends: Counter, longest: float) -> None:
    connection = Connection(server.port, 90.0)
    while True:
        try:
            seed = waiting.get_nowait()
        except queue.Empty:
            return
        try:
            ends[_one(connection, verdicts, seed, longest)] += 1
        except OSError as error:
            verdicts.fail(f"mutant {seed}: {error}")
            time.sleep(1)


def _one(connection: Connection, verdicts: Verdicts, seed: int, longest: float) -> str:
    """One mutant, from its submission to the purge of what it left."""
    name = f"mutant {seed}"
    ask = partial(_ask, connection, verdicts, name)
    answer = ask("POST", "/v1/jobs", json.dumps(mutated(seed)).encode())
    if answer.status != 202:
        return f"refused {answer.status}"
    job = answer.json()
    own = f"/v1/jobs/{job['id']}"
    submitted = began = time.monotonic()
    while job["status"] not in ENDED and time.monotonic() - submitted < LOST_AFTER:
        answer = ask("GET", f"{own}?wait=5")
        job = answer.json() if answer.status == 200 else job
        # Time in the queue does not count: all wait behind one that is slow.
        if job["status"] == "accepted":
            began = time.monotonic()
        elif job["status"] == "running" and time.monotonic() - began > longest:
            return _cancel(ask, verdicts, name, own, job)
    if job["status"] not in ENDED:
        verdicts.fail(f"{name}: {job['status']} after {LOST_AFTER:.0f} s")
        return "hung"
    slug = (job["problem"] or {}).get("type", "").rsplit("/", 1)[-1]
    if job["status"] == "failed" and slug not in HONEST:
        verdicts.fail(f"{name}: failed with {slug}: {job['problem']['detail'][:200]}")
    if job["map_id"]:
        _question(ask, job["map_id"], random.Random(seed))
        ask("DELETE", f"/v1/maps/{job['map_id']}")
    ask("DELETE", f"{own}?purge=true")
    return f"{job['status']} {slug}".strip()


def _ask(connection: Connection, verdicts: Verdicts, name: str, method: str, path: str, body=None) -> Answer:
    """An answer, judged."""
    answer = connection.ask(method, path, body)
    verdicts.judge_answer(f"{name} {method} {path}", answer, route=f"{method} {path}")
    return answer


def _cancel(ask: Callable[..., Answer], verdicts: Verdicts, name: str, own: str, job: dict) -> str:
    """Cancels a job that takes too long, which is a failure; whether its worker is free then, the next mutants tell."""
    at = job["progress"]
    verdicts.fail(f"{name}: runs too long; {at['stage']}, step {at['iteration']} of {at['max_iterations']}")
    ask("DELETE", own)
    return "cancelled"


def _question(ask: Callable[..., Answer], map_id: str, draw: random.Random) -> None:
    """A map's record, and a few of its answers with parameters at random."""
    own = f"/v1/maps/{map_id}"
    answer = ask("GET", own)
    if answer.status != 200:
        return
    lattice = answer.json()["lattice"]
    for question in draw.sample([_points, _picture, _window, _plain, _plain], 3):
        method, path, body = question(draw, lattice)
        ask(method, own + path, body)


def _points(draw: random.Random, lattice: dict) -> tuple:
    x, y = lattice["origin"]
    width, height = (n * lattice["resolution"] for n in lattice["cells"])
    inside = [[x + draw.random() * width, y + draw.random() * height] for _ in range(40)]
    edges = [[x, y], [x + width, y + height], [x + width, y], [x - 1e-12, y], [draw.choice(WILD), draw.choice(WILD)]]
    return "POST", "/query", {"points": inside + edges, "kind": draw.choice(["propagated", "posterior"])}


def _picture(draw: random.Random, lattice: dict) -> tuple:
    h = lattice["resolution"]
    choices = [
        f"/image?layer={layer}&overlay=contour,points,poses&width=300" for layer in ("distance", "sigma", "occupancy")
    ]
    choices += [
        f"/contours?level={level}&sigma_band={band}" for level in (0, 1e-300, -h, 3) for band in (0.001, 2, 100)
    ]
    choices += [f"/contours?format={form}&sigma_band=2&width=300" for form in ("svg", "png")]
    choices += [
        f"/ogm?resolution={max(1e-4, r)}&format={form}" for r in (h, h / 3, 7 * h) for form in ("json", "png", "zip")
    ]
    choices += [f"/grid?resolution={max(1e-4, r)}&format={form}" for r in (h, h / 3, 7 * h) for form in ("npz", "tiff")]
    return "GET", draw.choice(choices), None


def _window(draw: random.Random, lattice: dict) -> tuple:
    nx, ny = lattice["control_points"]
    ni, nj = draw.randint(1, min(nx, 6)), draw.randint(1, min(ny, 6))
    i0, j0 = draw.choice([0, nx - ni, (nx - ni) // 2]), draw.choice([0, ny - nj, (ny - nj) // 2])
    return (
        "GET",
        f"/covariance?form=block&i0={i0}&j0={j0}&ni={ni}&nj={nj}&kind={draw.choice(['propagated', 'posterior'])}",
        None,
    )


def _plain(draw: random.Random, lattice: dict) -> tuple:
    paths = [
        "/coefficients",
        "/coefficients?format=npz",
        "/poses",
        "/covariance",
        "/covariance?kind=posterior",
        "/covariance?form=sparse",
        "/covariance?form=factors",
    ]
    return "GET", draw.choice(paths), None
