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
    text = b"GET /livez HTTP/1.1\r\nHost: localhost\r\nX-Slow: " + b"x" * 200
    closed: set[int] = set()
    for letter in text:
        for number, wire in enumerate(wires):
            try:
                wire.sendall(bytes([letter]))
            except OSError:
                closed.add(number)
        if len(closed) == len(wires) or stage.over.wait(2.0):
            break
    lasted = time.monotonic() - began
    for wire in wires:
        wire.close()
    return (
        [f"{len(wires) - len(closed)} slow headers are open after {lasted:.0f} s"]
        if lasted > 45 and len(closed) < len(wires)
        else []
    )


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
