"""One hostile request, as bytes on the wire, and what a service that keeps its countenance may answer."""

import json
from dataclasses import dataclass, field

JSON = "application/json"


@dataclass(frozen=True)
class Scene:
    """What is there to be attacked: a port, a signed and a vector map, and the job of the first."""

    port: int
    sdf: str
    vdf: str
    job: str
    document: dict


@dataclass
class Attack:
    """`pieces` are sent in turn; a number is a pause, seconds. `expect` are beginnings of a status ("4", "422"), or
    "closed" where hanging up without a word will do; several answers to one attack must all be expected."""

    name: str
    pieces: list[bytes | float]
    expect: tuple[str, ...]
    within: float = 10.0
    answers: int = 1
    #: The client goes once all is sent, without reading.
    leaves: bool = False
    tags: set[str] = field(default_factory=set)


def message(
    method: str, target: str, headers: dict[str, str] | list[tuple[str, str]] | None = None, body: bytes | None = None
) -> bytes:
    """A request that closes its connection. `headers` replace the usual ones; as a list they are sent as they are."""
    if isinstance(headers, list):
        lines = headers
    else:
        usual = {"Host": "localhost", "Connection": "close"}
        if body is not None:
            usual |= {"Content-Type": JSON, "Content-Length": str(len(body))}
        lines = [(name, value) for name, value in (usual | (headers or {})).items() if value is not None]
    head = f"{method} {target} HTTP/1.1\r\n" + "".join(f"{name}: {value}\r\n" for name, value in lines)
    return head.encode("latin-1", "replace") + b"\r\n" + (body or b"")


def get(name: str, target: str, *expect: str, within: float = 10.0, **headers: str) -> Attack:
    named = {key.replace("_", "-"): value for key, value in headers.items()}
    return Attack(name, [message("GET", target, named)], expect, within)


def post(name: str, target: str, body, *expect: str, within: float = 10.0, **headers: str) -> Attack:
    """`body` is bytes, or what becomes JSON."""
    named = {key.replace("_", "-"): value for key, value in headers.items()}
    raw = body if isinstance(body, bytes) else json.dumps(body).encode()
    return Attack(name, [message("POST", target, named, raw)], expect, within)


def raw(name: str, text: str | bytes, *expect: str, within: float = 10.0, answers: int = 1) -> Attack:
    """Bytes as they are."""
    return Attack(name, [text if isinstance(text, bytes) else text.encode("latin-1")], expect, within, answers)
