"""Who is there beside the one who asks: fits on every worker, and a crowd that holds connections."""

import json
import multiprocessing
import os
import socket
import threading
import time
from multiprocessing.connection import Connection as Pipe

from jobs import rooms
from service.connection import Connection

# The service closes a connection that said nothing for 30 s; the crowd comes again before that.
AGAIN = 20.0
IDLE, LISTENERS = 2000, 1000
# Long jobs a worker in the queue.
QUEUED = 12


class Fits:
    """Keeps every worker at fits, one after the other, until it is told to stop."""

    def __init__(self, connection: Connection, workers: int):
        self._connection, self._workers = connection, workers
        self._ids = [self._submit(k) for k in range(QUEUED * workers)]
        until = time.monotonic() + 60.0
        while self._now("running") < workers:
            if time.monotonic() > until:
                raise RuntimeError("the workers do not begin")
            time.sleep(0.1)
        # Until the first are past reading their requests.
        time.sleep(1.0)

    def check(self) -> None:
        """Raises where a worker was free in between: what was measured would not be what is said."""
        if self._now("accepted") == 0:
            raise RuntimeError("no job waits any more: a worker may have been free")

    def stop(self) -> None:
        for job in reversed(self._ids):
            self._connection.ask("DELETE", f"/v1/jobs/{job}")
        # A fit stops within a step.
        time.sleep(2.0)

    @property
    def followed(self) -> str:
        """A job that runs."""
        return self._listed("running")[0]["id"]

    @staticmethod
    def need(connection: Connection) -> int:
        """Bytes that one fit needs by the service's own estimate."""
        return connection.ask("POST", "/v1/jobs?dry_run=true", _long(0)).json()["estimate"]["bytes"]

    def _submit(self, seed: int) -> str:
        answer = self._connection.ask("POST", "/v1/jobs", _long(seed))
        if answer.status != 202:
            raise RuntimeError(f"a long job is not taken: {answer.status} {answer.body[:300]!r}")
        return answer.json()["id"]

    def _now(self, status: str) -> int:
        return len(self._listed(status))

    def _listed(self, status: str) -> list[dict]:
        return self._connection.ask("GET", f"/v1/jobs?status={status}&limit=100").json()["items"]


def _long(seed: int) -> dict:
    """A job of 200 x 200 control points: some seconds."""
    job = rooms.job(seed, 0.04)
    job["map"] |= {"bounds": {"min": [0, 0], "max": [8, 8]}}
    job["fit"] = {"max_iterations": 1000, "tolerance": 1e-14}
    return job


class Loops:
    """As many processes as there are cores, at the lowest priority, that compute and touch nothing of the service's.

    What they cost a question is the machine's: its scheduler gives a core up only when a slice of it ends.
    """

    def __init__(self):
        self._processes = [multiprocessing.Process(target=_loop, daemon=True) for _ in range(os.cpu_count() or 1)]
        for process in self._processes:
            process.start()
        time.sleep(1.0)

    def stop(self) -> None:
        for process in self._processes:
            process.kill()
            process.join()


def _loop() -> None:
    os.nice(19)
    while True:
        pass


class Crowd:
    """A crowd in a process of its own: what it does is not to hold up the one who asks."""

    def __init__(self, port: int, job: str, a_map: str):
        self._pipe, theirs = multiprocessing.Pipe()
        self._process = multiprocessing.Process(target=_stay, args=(port, job, a_map, theirs), daemon=True)
        self._process.start()
        self._pipe.recv()

    def leave(self) -> None:
        self._pipe.send("leave")
        self._process.join()
        time.sleep(1.0)


def _stay(port: int, job: str, a_map: str, pipe: Pipe) -> None:
    members = Members(port, job, a_map)
    pipe.send("there")
    pipe.recv()
    members.leave()


class Members:
    """2,000 connections that say nothing, 1,000 that follow a job's events, and one who takes a large answer slowly."""

    def __init__(self, port: int, job: str, a_map: str):
        self._address = ("127.0.0.1", port)
        self._over = threading.Event()
        self._follow = f"GET /v1/jobs/{job}/events HTTP/1.1\r\nHost: localhost\r\n\r\n".encode()
        body = json.dumps({"points": [[1.0, 1.0 + k * 1e-6] for k in range(100_000)]}).encode()
        head = f"POST /v1/maps/{a_map}/query HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        self._large = head.encode() + b"Content-Length: %d\r\n\r\n" % len(body) + body
        self._silent = [self._dial() for _ in range(IDLE)]
        self._listeners = [self._dial(self._follow) for _ in range(LISTENERS)]
        self._threads = [threading.Thread(target=act, daemon=True) for act in (self._come_again, self._sip)]
        for thread in self._threads:
            thread.start()
        time.sleep(2.0)

    def leave(self) -> None:
        self._over.set()
        for thread in self._threads:
            thread.join()
        for wire in self._silent + self._listeners:
            wire.close()

    def _dial(self, say: bytes = b"") -> socket.socket:
        wire = socket.create_connection(self._address, 30.0)
        wire.sendall(say)
        return wire

    def _come_again(self) -> None:
        """Opens the silent connections anew, a few at a time; keeps the listeners' ends empty."""
        while not self._over.wait(AGAIN * 20 / IDLE):
            old, self._silent = self._silent[:20], self._silent[20:]
            for wire in old:
                wire.close()
            self._silent += [self._dial() for _ in old]
            for wire in self._listeners[:20]:
                self._drain(wire)
            self._listeners = self._listeners[20:] + self._listeners[:20]

    def _drain(self, wire: socket.socket) -> None:
        wire.setblocking(False)
        try:
            while wire.recv(1 << 16):
                pass
        except OSError:
            # Nothing more just now.
            pass

    def _sip(self) -> None:
        """Takes a kilobyte of an answer of megabytes ten times a second."""
        wire = self._dial(self._large)
        while not self._over.wait(0.1):
            wire.recv(1024)
        wire.close()
