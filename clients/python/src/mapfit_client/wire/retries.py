"""Whether and when to ask again.

429 and 503 say that nothing was done, so anything may be asked again, after the seconds of `Retry-After` where there
are any. A broken connection, 502 and 504 leave open whether the request was carried out: what is repeatable is asked
again, and so is anything that never left because no connection was had. Pauses double, with some chance in them, so
that a fleet does not come back in step.
"""

import random
from dataclasses import dataclass
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime

import httpx2

from ..errors import MapfitError, NotReachable
from ..records import Problem
from .exchange import Answer, Ask

Outcome = Answer | httpx2.RequestError

_NOTHING_WAS_DONE = {429, 503}
_NOBODY_KNOWS = {502, 504}
_NEVER_LEFT = (httpx2.ConnectError, httpx2.ConnectTimeout, httpx2.PoolTimeout)
_LONGEST = 60.0


@dataclass(frozen=True)
class Retries:
    """How often to ask at most, and the first pause in seconds."""

    tries: int = 6
    first_pause: float = 0.5

    def pause(self, ask: Ask, asked: int, outcome: Outcome) -> float | None:
        """Seconds until asking again, having asked so often; None where the outcome stands."""
        if asked >= (ask.tries or self.tries) or not _is_worth_it(ask, outcome):
            return None
        if isinstance(outcome, Answer) and (named := _retry_after(outcome.headers.get("retry-after"))) is not None:
            return min(named, _LONGEST)
        doubled = float(self.first_pause * 2 ** (asked - 1))
        return min(doubled, _LONGEST) * random.uniform(0.5, 1.0)


def settled(ask: Ask, outcome: Outcome) -> Answer:
    """An outcome that stands: the answer, or the error it is."""
    if isinstance(outcome, httpx2.RequestError):
        reason = str(outcome) or type(outcome).__name__
        detail = f"{ask.method} {ask.path}: {reason}"
        raise NotReachable(
            {"type": "/problems/not-reachable", "title": "The service cannot be reached", "status": 0, "detail": detail}
        ) from outcome
    if outcome.status >= 400:
        raise MapfitError(_problem(ask, outcome))
    return outcome


def _is_worth_it(ask: Ask, outcome: Outcome) -> bool:
    if isinstance(outcome, Answer):
        return outcome.status in _NOTHING_WAS_DONE or (ask.repeatable and outcome.status in _NOBODY_KNOWS)
    on_the_way = isinstance(outcome, httpx2.TimeoutException | httpx2.NetworkError | httpx2.RemoteProtocolError)
    return on_the_way and (ask.repeatable or isinstance(outcome, _NEVER_LEFT))


def _retry_after(text: str | None) -> float | None:
    if text is None:
        return None
    try:
        return max(float(text), 0.0)
    except ValueError:
        pass
    try:
        return max((parsedate_to_datetime(text) - datetime.now(UTC)).total_seconds(), 0.0)
    except (ValueError, TypeError):
        return None


def _problem(ask: Ask, answer: Answer) -> Problem:
    """The answer's problem; where something else answered than the service, one that says so."""
    if answer.headers.get("content-type", "").startswith("application/problem+json"):
        problem: Problem = answer.json()
        return problem
    text = answer.body[:200].decode(errors="replace").strip()
    detail = f"{ask.method} {ask.path}: {text or 'no explanation was given'}"
    return {"type": "about:blank", "title": f"HTTP {answer.status}", "status": answer.status, "detail": detail}
