"""HTTP as a client of the service speaks it: one connection, opened again where it broke."""

import http.client
import json
import time
from dataclasses import dataclass
from typing import Any

from .strict_json import parse


@dataclass
class Answer:
    """Status, headers (names in lower case) and body of one answer."""

    status: int
    headers: dict[str, str]
    body: bytes

    def json(self) -> Any:
        """The body, read by a parser that refuses what JSON does not have."""
        return parse(self.body)

    def is_problem(self) -> bool:
        """Whether it is an RFC 9457 problem with the members the contract names."""
        if not self.headers.get("content-type", "").startswith("application/problem+json"):
            return False
        try:
            problem = self.json()
        except ValueError:
            return False
        wanted = ("type", "title", "status", "detail", "instance", "request_id")
        return isinstance(problem, dict) and all(problem.get(member) is not None for member in wanted)


# The service closes a connection that is idle for 30 s; one that was idle for so long is opened anew.
FRESH = 15.0


class Connection:
    """Asks one thing at a time. `OSError` where the service is away, whatever http.client calls it."""

    def __init__(self, port: int, timeout: float = 30.0):
        self.port = port
        self.timeout = timeout
        self._open: http.client.HTTPConnection | None = None
        self._last = 0.0

    def ask(self, method: str, path: str, body: Any = None, headers: dict[str, str] | None = None) -> Answer:
        """Sends a request; `body` is bytes, or what becomes JSON."""
        headers = dict(headers or {})
        if body is not None and not isinstance(body, bytes):
            body = json.dumps(body).encode()
        if body is not None:
            headers.setdefault("content-type", "application/json")
        if time.monotonic() - self._last > FRESH:
            self.close()
        if self._open is None:
            self._open = http.client.HTTPConnection("127.0.0.1", self.port, timeout=self.timeout)
        try:
            self._open.request(method, path, body, headers)
            answer = self._open.getresponse()
            names = {name.lower(): value for name, value in answer.getheaders()}
            body = answer.read()
            self._last = time.monotonic()
            return Answer(answer.status, names, body)
        except (OSError, http.client.HTTPException) as error:
            self.close()
            raise OSError(f"{method} {path[:80]}: {error!r}") from error

    def close(self) -> None:
        if self._open is not None:
            self._open.close()
            self._open = None

    def pages(self, path: str) -> list[dict]:
        """All items of a list, page by page."""
        items, cursor = [], None
        joint = "&" if "?" in path else "?"
        while True:
            more = f"&cursor={cursor}" if cursor else ""
            answer = self.ask("GET", f"{path}{joint}limit=500{more}")
            if answer.status != 200:
                raise OSError(f"GET {path}: {answer.status}")
            page = answer.json()
            items += page["items"]
            cursor = page["next_cursor"]
            if cursor is None:
                return items
