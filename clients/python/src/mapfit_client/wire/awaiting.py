"""Exchanges carried by an awaiting transport."""

import asyncio
from typing import TypeVar

import httpx2

from .exchange import Answer, Ask, Exchange
from .retries import Outcome, Retries, settled
from .settings import Settings, answer, arguments

T = TypeVar("T")


class AsyncConnection:
    """A service, asked by any number of tasks."""

    def __init__(self, settings: Settings, retries: Retries, transport: httpx2.AsyncBaseTransport | None) -> None:
        self._http = httpx2.AsyncClient(transport=transport, **settings)
        self._retries = retries

    async def run(self, exchange: Exchange[T]) -> T:
        """Carries an exchange to its end."""
        try:
            ask = next(exchange)
            while True:
                ask = exchange.send(await self._ask(ask))
        except StopIteration as end:
            result: T = end.value
            return result

    async def close(self) -> None:
        """Closes its sockets."""
        await self._http.aclose()

    async def _ask(self, ask: Ask) -> Answer:
        pause: float | None = ask.after
        asked = 0
        while pause is not None:
            await asyncio.sleep(pause)
            outcome = await self._once(ask)
            asked += 1
            pause = self._retries.pause(ask, asked, outcome)
        return settled(ask, outcome)

    async def _once(self, ask: Ask) -> Outcome:
        try:
            return answer(await self._http.request(**arguments(ask)))
        except httpx2.RequestError as error:
            return error
