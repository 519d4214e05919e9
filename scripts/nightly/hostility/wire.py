"""Sends an attack byte by byte and reads whatever comes back, until the service hangs up or time is up."""

import select
import socket
import time
from dataclasses import dataclass

from service.connection import Answer

from .attack import Attack


# Seconds after which a connection that says nothing may have said all.
QUIET = 0.02


@dataclass
class Outcome:
    """All answers on the connection, whether it was closed by the service, and how long all took."""

    answers: list[Answer]
    closed: bool
    seconds: float


def carry_out(attack: Attack, port: int) -> Outcome:
    """Carries out an attack on a connection of its own."""
    began = time.monotonic()
    received, closed = bytearray(), False
    with socket.create_connection(("127.0.0.1", port), timeout=attack.within) as wire:
        for piece in attack.pieces:
            if isinstance(piece, float):
                time.sleep(piece)
                continue
            try:
                wire.sendall(piece)
            except OSError:
                # It hung up on us while we sent: what it said before is still to be read.
                break
        while not attack.leaves and (left := began + attack.within - time.monotonic()) > 0:
            if not select.select([wire], [], [], min(left, QUIET))[0]:
                # What was received is looked at only now: it may be megabytes, in many pieces.
                if enough(received, attack.answers):
                    break
                continue
            try:
                piece = wire.recv(1 << 20)
            except OSError:
                closed = True
                break
            if not piece:
                closed = True
                break
            received += piece
    return Outcome(_answers(bytes(received))[0], closed, time.monotonic() - began)


def enough(received: bytes, wanted: int) -> bool:
    """Whether so many whole answers have come, interim ones (100) aside."""
    if b"\r\n\r\n" not in received:
        return False
    answers, whole = _answers(bytes(received))
    return whole and sum(answer.status >= 200 for answer in answers) >= wanted


def _answers(received: bytes) -> tuple[list[Answer], bool]:
    """The answers, and whether the last is whole."""
    answers = []
    while received:
        head, gap, rest = received.partition(b"\r\n\r\n")
        if not gap or not head.startswith(b"HTTP/1."):
            return answers, False
        first, *lines = head.decode("latin-1").split("\r\n")
        headers = {name.lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
        status = int(first.split()[1])
        body, received, whole = _body(status, headers, rest)
        answers.append(Answer(status, headers, body))
        if not whole:
            return answers, False
    return answers, True


def _body(status: int, headers: dict[str, str], rest: bytes) -> tuple[bytes, bytes, bool]:
    """An answer's body, what follows it, and whether it is whole."""
    if status < 200 or status in (204, 304):
        return b"", rest, True
    if "content-length" in headers:
        length = int(headers["content-length"])
        return rest[:length], rest[length:], len(rest) >= length
    if headers.get("transfer-encoding") == "chunked":
        body, at = bytearray(), 0
        while (line := rest.find(b"\r\n", at)) >= 0:
            length = int(rest[at:line].split(b";")[0] or b"0", 16)
            at = line + 2
            if length == 0:
                return bytes(body), rest[at:].removeprefix(b"\r\n"), True
            body += rest[at : at + length]
            if len(rest) < at + length + 2:
                return bytes(body), b"", False
            at += length + 2
        return bytes(body), b"", False
    return rest, b"", False
