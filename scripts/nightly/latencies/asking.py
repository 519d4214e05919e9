"""Small questions, timed: a job's state, and one point of a map, on one connection each, one after the other."""

import json
import random
import socket
import time
from dataclasses import dataclass

# Seconds between an answer and the next question, on average: a client that asks, not one that hammers.
PAUSE = 0.002


@dataclass
class Question:
    """A request as it goes over the wire."""

    name: str
    message: bytes


def state_of(job: str) -> Question:
    return Question("status", f"GET /v1/jobs/{job} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())


def one_point(a_map: str) -> Question:
    body = json.dumps({"points": [[1.0, 1.0]]}).encode()
    head = f"POST /v1/maps/{a_map}/query HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    return Question("point", head.encode() + b"Content-Length: %d\r\n\r\n" % len(body) + body)


class Asker:
    """Asks questions over one connection, without a library between it and the clock."""

    def __init__(self, port: int):
        self._wire = socket.create_connection(("127.0.0.1", port), 30.0)
        self._wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._draw = random.Random(1)

    def times(self, question: Question, count: int) -> list[float]:
        """Milliseconds that each of so many answers took."""
        times = []
        for _ in range(count):
            time.sleep(PAUSE * 2 * self._draw.random())
            began = time.perf_counter()
            self._wire.sendall(question.message)
            status = self._answer()
            times.append(1000 * (time.perf_counter() - began))
            if status != 200:
                raise RuntimeError(f"{question.name}: {status}")
        return times

    def close(self) -> None:
        self._wire.close()

    def _answer(self) -> int:
        """Reads one whole answer; its status."""
        got = b""
        while b"\r\n\r\n" not in got:
            got += self._more()
        head, body = got.split(b"\r\n\r\n", 1)
        lines = head.decode("latin-1").split("\r\n")
        names = dict(line.lower().split(": ", 1) for line in lines[1:])
        if "content-length" in names:
            left = int(names["content-length"]) - len(body)
            while left > 0:
                left -= len(self._more())
        else:
            while not body.endswith(b"0\r\n\r\n"):
                body += self._more()
        return int(lines[0].split(" ")[1])

    def _more(self) -> bytes:
        piece = self._wire.recv(1 << 16)
        if not piece:
            raise OSError("the service hung up")
        return piece


def percentile(times: list[float], share: float) -> float:
    ordered = sorted(times)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]
