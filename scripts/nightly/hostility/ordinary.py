"""One client that means no harm, in a process of its own: what it sees is what the service is worth under attack."""

import multiprocessing
import threading
import time
from multiprocessing.connection import Connection as Pipe

from jobs import rooms
from service.connection import Connection

# Seconds from one look at /livez to the next, and from one job to the next.
LOOKS = 0.1
SUBMITS = 0.5
ENDED = ("successful", "failed", "dismissed")


def percentile(values: list[float], share: float) -> float | None:
    """The least value that so large a share of all does not exceed."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else None


class Ordinary:
    """Submits small jobs and asks for /livez until told to stop; then waits for its jobs."""

    def __init__(self, port: int, patience: float):
        self._pipe, theirs = multiprocessing.Pipe()
        self._process = multiprocessing.Process(target=_client, args=(port, patience, theirs), daemon=True)
        self._process.start()

    def stop(self) -> dict:
        """What it saw."""
        self._pipe.send("stop")
        seen = self._pipe.recv()
        self._process.join()
        return seen


def _client(port: int, patience: float, pipe: Pipe) -> None:
    livez: list[float] = []
    posts: list[float] = []
    ids: list[str] = []
    troubles: list[str] = []
    over = threading.Event()

    def look() -> None:
        while not over.wait(LOOKS):
            _timed(Connection(port, 20.0), "GET", "/livez", None, (200,), livez, troubles)

    def submit() -> None:
        while not over.wait(SUBMITS):
            job = rooms.job(len(posts), 0.6)
            answer = _timed(Connection(port, 70.0), "POST", "/v1/jobs", job, (202,), posts, troubles)
            if answer is not None:
                ids.append(answer["id"])

    threads = [threading.Thread(target=look), threading.Thread(target=submit)]
    for thread in threads:
        thread.start()
    pipe.recv()
    over.set()
    for thread in threads:
        thread.join()
    ends = _ends(Connection(port, 90.0), ids, patience)
    pipe.send(
        {
            "livez": len(livez),
            "livez_p99_ms": _milliseconds(percentile(livez, 0.99)),
            "livez_max_ms": _milliseconds(max(livez, default=None)),
            "posts": len(posts),
            "post_p99_ms": _milliseconds(percentile(posts, 0.99)),
            "post_max_ms": _milliseconds(max(posts, default=None)),
            "jobs": len(ids),
            "successful": ends.count("successful"),
            "troubles": troubles,
        }
    )


def _timed(connection: Connection, method: str, path: str, body, good: tuple, times: list, troubles: list):
    """Asks and notes how long it took; what is refused or breaks is a trouble, and its time counts, too."""
    began = time.monotonic()
    try:
        answer = connection.ask(method, path, body)
        if answer.status not in good:
            troubles.append(f"{method} {path}: {answer.status} after {time.monotonic() - began:.1f} s")
            return None
        return answer.json() if answer.headers.get("content-type", "").startswith("application/json") else None
    except OSError as error:
        troubles.append(f"{error} after {time.monotonic() - began:.1f} s")
        return None
    finally:
        times.append(time.monotonic() - began)
        connection.close()


def _ends(connection: Connection, ids: list[str], patience: float) -> list[str]:
    """How the jobs end, those that do within the patience."""
    until = time.monotonic() + patience
    ends = []
    for job_id in ids:
        status = "unknown"
        while status not in ENDED and time.monotonic() < until:
            try:
                status = connection.ask("GET", f"/v1/jobs/{job_id}?wait=1").json().get("status", "unknown")
            except OSError:
                time.sleep(0.5)
        ends.append(status)
    return ends


def _milliseconds(seconds: float | None) -> float | None:
    return None if seconds is None else round(1000 * seconds, 1)
