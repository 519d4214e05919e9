"""Exchanges carried by a blocking transport."""

import time
from typing import TypeVar

import httpx2

from .exchange import Answer, Ask, Exchange
from .retries import Outcome, Retries, settled
from .settings import Settings, answer, arguments

T = TypeVar("T")


class Connection:
    """A service, asked one thing after the other."""

    def __init__(self, settings: Settings, retries: Retries, transport: httpx2.BaseTransport | None) -> None:
        self._http = httpx2.Client(transport=transport, **settings)
        self._retries = retries

    def run(self, exchange: Exchange[T]) -> T:
        """Carries an exchange to its end."""
        try:
            ask = next(exchange)
            while True:
                ask = exchange.send(self._ask(ask))
        except StopIteration as end:
            result: T = end.value
            return result

    def close(self) -> None:
        """Closes its sockets."""
        self._http.close()

    def _ask(self, ask: Ask) -> Answer:
        pause: float | None = ask.after
        asked = 0
        while pause is not None:
            time.sleep(pause)
            outcome = self._once(ask)
            asked += 1
            pause = self._retries.pause(ask, asked, outcome)
        return settled(ask, outcome)

    def _once(self, ask: Ask) -> Outcome:
        try:
            return answer(self._http.request(**arguments(ask)))
        except httpx2.RequestError as error:
            return error
