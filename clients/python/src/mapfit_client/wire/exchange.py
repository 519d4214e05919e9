"""A conversation with the service, without a socket.

An exchange is a generator: it yields what to ask (`Ask`), is sent the service's `Answer`, and returns what came of
it. It says once what is asked and how an answer is read; a blocking and an awaiting transport carry the same exchange
(`wire.blocking`, `wire.awaiting`). Refusals never reach it: the transport raises them.
"""

import io
import json
from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

NPZ = {"accept": "application/x-npz"}

T = TypeVar("T")


@dataclass(frozen=True)
class Ask:
    """A request. `repeatable`: asking twice does no more than asking once, even if the first answer was lost."""

    method: str
    path: str
    params: Mapping[str, str | list[str]] = field(default_factory=dict)
    headers: Mapping[str, str] = field(default_factory=dict)
    body: bytes | None = None
    repeatable: bool = True
    tries: int | None = None
    """Where it is more patient than the client is otherwise."""
    after: float = 0.0
    """Seconds to wait before asking."""


@dataclass(frozen=True)
class Answer:
    """A response, received whole. Header names are in lower case."""

    status: int
    headers: Mapping[str, str]
    body: bytes

    def json(self) -> Any:
        """The body as JSON."""
        return json.loads(self.body)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The body's arrays by name (npz); nothing in it is ever executed."""
        with np.load(io.BytesIO(self.body), allow_pickle=False) as archive:
            return dict(archive)


Exchange = Generator[Ask, Answer, T]


def address(*parts: str) -> str:
    """The path of a resource under /v1, whatever its names are made of."""
    return "/v1/" + "/".join(quote(part, safe="") for part in parts)


def get_json(path: str, params: Mapping[str, str | list[str]] | None = None) -> Exchange[Any]:
    """A resource as JSON."""
    answer = yield Ask("GET", path, params=params or {})
    return answer.json()


def with_json(method: str, path: str, content: Any, repeatable: bool) -> Ask:
    """A request with a JSON body."""
    body = json.dumps(content, allow_nan=False).encode()
    return Ask(method, path, headers={"content-type": "application/json"}, body=body, repeatable=repeatable)
