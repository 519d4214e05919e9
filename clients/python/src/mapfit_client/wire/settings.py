"""What both transports are made from."""

from typing import Any, TypedDict

import httpx2

from .. import version
from .exchange import Answer, Ask

TIMEOUT = httpx2.Timeout(90.0, connect=10.0)
"""Longer than the service's own limit for an answer (60 s), so that it is the one to say so."""


class Settings(TypedDict):
    """The arguments of an httpx2 client."""

    base_url: str
    headers: dict[str, str]
    timeout: httpx2.Timeout
    follow_redirects: bool


def settings(url: str, key: str | None, timeout: float | None) -> Settings:
    """For a service at an address; one without a scheme is http."""
    address = url if "://" in url else f"http://{url}"
    headers = {"user-agent": f"mapfit-client/{version.VERSION}"}
    if key is not None:
        headers["authorization"] = f"Bearer {key}"
    return {
        "base_url": address.rstrip("/"),
        "headers": headers,
        "timeout": TIMEOUT if timeout is None else httpx2.Timeout(timeout, connect=min(timeout, 10.0)),
        "follow_redirects": True,
    }


def arguments(ask: Ask) -> dict[str, Any]:
    """A request as httpx2 takes it."""
    return {
        "method": ask.method,
        "url": ask.path,
        "params": dict(ask.params),
        "headers": dict(ask.headers),
        "content": ask.body,
    }


def answer(response: httpx2.Response) -> Answer:
    """A response as exchanges take it."""
    return Answer(
        response.status_code, {name.lower(): value for name, value in response.headers.items()}, response.content
    )
