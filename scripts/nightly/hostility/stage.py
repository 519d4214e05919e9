"""Where the crowd is let loose, and what every row of the table needs."""

import socket
import threading
from collections.abc import Callable
from dataclasses import dataclass

from jobs import rooms


@dataclass
class Stage:
    """Where the crowd is let loose."""

    port: int
    #: A map of 447 x 447 control points.
    large: str
    #: Copies of it, under ids of their own.
    others: list[str]
    #: Whether it is time to leave.
    over: threading.Event
    #: What the server has spent so far.
    cpu_seconds: Callable[[], float]
    #: Whether one row alone is here.
    alone: bool

    def dial(self, timeout: float = 100.0) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.port), timeout)


def large_job(iterations: int) -> dict:
    """A job of 447 x 447 control points, over so many steps."""
    job = rooms.job(3, 0.02)
    job["map"] |= {"bounds": {"min": [-0.4, -0.4], "max": [-0.4 + 444 * 0.02, -0.4 + 444 * 0.02]}}
    job["fit"] = {"max_iterations": iterations, "poses": "fixed"}
    return job


def together(count: int, one: Callable[[int, list[str]], None]) -> list[str]:
    """Does one thing so many times at once; all complaints."""
    complaints: list[str] = []
    threads = [threading.Thread(target=one, args=(k, complaints), daemon=True) for k in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return complaints


def judge(complaints: list[str], what: str, answer, allowed: tuple[int, ...]) -> None:
    if answer.status not in allowed:
        complaints.append(f"{what}: {answer.status} {answer.body[:120]!r}")
    elif answer.status == 503 and not answer.is_problem():
        complaints.append(f"{what}: 503 without a problem")
