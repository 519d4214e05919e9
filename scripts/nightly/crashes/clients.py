"""Clients that keep asking through outages: submitters with idempotency keys, and a watcher of ends."""

import queue
import random
import threading
import time

from service.connection import Answer, Connection

from .ledger import Entry, Ledger

# An answer that says "later"; anything else that is not expected is a failure.
LATER = (429, 503)
PAUSE = 0.05


class Clients:
    """Submitter threads, a canceller's patience within them, and one thread that watches."""

    def __init__(self, ledger: Ledger, port: int, threads: int):
        self.ledger, self.port = ledger, port
        self.waiting: queue.Queue[Entry | None] = queue.Queue()
        self.faults: list[str] = []
        self.outages = 0
        self.submitted = 0
        self.slowest = 0.0
        self._over = threading.Event()
        self._threads = [threading.Thread(target=self._submit, daemon=True) for _ in range(threads)]
        self._watcher = threading.Thread(target=self._watch, daemon=True)

    def start(self) -> None:
        for thread in [*self._threads, self._watcher]:
            thread.start()

    def release(self, entry: Entry) -> None:
        self.waiting.put(entry)

    def finish(self) -> None:
        """Waits until everything released was accepted, then ends the threads."""
        for _ in self._threads:
            self.waiting.put(None)
        for thread in self._threads:
            thread.join()
        self._over.set()
        self._watcher.join()

    def _insist(self, connection: Connection, method: str, path: str, good: tuple, **more) -> Answer | None:
        """Asks until the answer is a good one, however often the service is away."""
        began = time.monotonic()
        while time.monotonic() - began < 240:
            try:
                answer = connection.ask(method, path, **more)
            except OSError:
                self.outages += 1
                time.sleep(PAUSE)
                continue
            if answer.status in good:
                self.slowest = max(self.slowest, time.monotonic() - began)
                return answer
            if answer.status not in LATER:
                self.faults.append(f"{method} {path}: {answer.status} {answer.body[:200]!r}")
                return None
            if not answer.is_problem():
                self.faults.append(f"{method} {path}: {answer.status} without a problem")
            time.sleep(PAUSE)
        self.faults.append(f"{method} {path}: no answer in 240 s")
        return None

    def _submit(self) -> None:
        connection = Connection(self.port)
        while (entry := self.waiting.get()) is not None:
            headers = {"idempotency-key": entry.key}
            answer = self._insist(connection, "POST", "/v1/jobs", (200, 202), body=entry.document, headers=headers)
            self.submitted += 1
            if answer is None:
                continue
            self.ledger.accepted(entry, answer.json(), again=answer.status == 200)
            if entry.kind == "cancelled":
                time.sleep(entry.cancel_after)
                answer = self._insist(connection, "DELETE", f"/v1/jobs/{entry.id}", (200, 409))
                if answer is not None and answer.status == 200:
                    entry.dismissed = True
                    self.ledger.saw(entry, answer.json())

    def _watch(self) -> None:
        """Looks at jobs again and again: an end, once told, must stay."""
        connection, draw = Connection(self.port), random.Random(0)
        while not self._over.is_set():
            known = [entry for entry in self.ledger.entries if entry.id]
            for entry in draw.sample(known, min(5, len(known))):
                try:
                    answer = connection.ask("GET", f"/v1/jobs/{entry.id}")
                except OSError:
                    continue
                if answer.status == 200:
                    self.ledger.saw(entry, answer.json())
                elif answer.status not in LATER:
                    self.faults.append(f"GET {entry.id}: {answer.status}, though it was accepted")
            try:
                connection.ask("GET", "/readyz")
            except OSError:
                pass
            time.sleep(2 * PAUSE)


def until_empty(connection: Connection, within: float, tell=lambda left: None) -> bool:
    """Waits for every job to have ended; `tell` hears how many wait or run, a thousand at most."""
    began = time.monotonic()
    while time.monotonic() - began < within:
        pages = [connection.ask("GET", f"/v1/jobs?limit=1000&status={status}") for status in ("accepted", "running")]
        left = sum(len(page.json()["items"]) if page.status == 200 else 1 for page in pages)
        tell(left)
        if left == 0:
            return True
        time.sleep(0.5)
    return False
