"""Rows of the table that hold connections and give nothing for them, until the crowd leaves."""

import json
import socket
import time

from .attack import message
from .stage import Stage, together


def slow_headers(stage: Stage) -> list[str]:
    """200 connections whose header comes a letter every two seconds: each is closed within 45 s."""
    wires = [stage.dial() for _ in range(200)]
    began = time.monotonic()
    for letter in b"GET /livez HTTP/1.1\r\nHost: localhost\r\nX-Slow: " + b"x" * 200:
        for wire in wires:
            try:
                wire.sendall(bytes([letter]))
            except OSError:
                # Closed already; counted below.
                pass
        if time.monotonic() - began > 45:
            break
        time.sleep(2.0)
    still = sum(not _hung_up(wire) for wire in wires)
    for wire in wires:
        wire.close()
    return [f"{still} slow headers are open after {time.monotonic() - began:.0f} s"] if still else []


def _hung_up(wire: socket.socket) -> bool:
    """Whether the service closed a connection, its last words aside."""
    wire.settimeout(0.05)
    try:
        while wire.recv(1 << 16):
            pass
        return True
    except TimeoutError:
        return False
    except OSError:
        return True


def slow_readers(stage: Stage) -> list[str]:
    """15 clients that ask 250,000 points each and take nothing of the answer."""
    points = json.dumps(
        {"points": [[0.5 + (k % 500) * 0.01, 0.5 + (k // 500) * 0.01] for k in range(250_000)]}
    ).encode()
    request = message("POST", f"/v1/maps/{stage.large}/query", None, points)
    wires: list[socket.socket] = []

    def one(_: int, complaints: list[str]) -> None:
        try:
            wire = stage.dial()
            wires.append(wire)
            wire.sendall(request)
        except OSError:
            # Refused or hung up on while sending: nothing is held for it.
            pass

    complaints = together(15, one)
    stage.over.wait()
    for wire in wires:
        wire.close()
    return complaints


def unfinished(stage: Stage) -> list[str]:
    """30 bodies of 63 MiB whose last byte never comes."""
    head = b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    size = 63 << 20
    wires: list[socket.socket] = []

    def one(_: int, complaints: list[str]) -> None:
        try:
            wire = stage.dial(20.0)
            wires.append(wire)
            wire.sendall(head + b"Content-Length: %d\r\n\r\n" % size)
            piece = b" " * (1 << 20)
            for _ in range(62):
                wire.sendall(piece)
        except OSError:
            pass

    complaints = together(30, one)
    stage.over.wait()
    for wire in wires:
        wire.close()
    return complaints


def idle(stage: Stage) -> list[str]:
    """2,000 connections that say nothing."""
    wires = []
    complaints = []
    try:
        wires = [stage.dial(10.0) for _ in range(2000)]
    except OSError as error:
        complaints.append(f"idle connections: {error}")
    stage.over.wait()
    for wire in wires:
        wire.close()
    return complaints
