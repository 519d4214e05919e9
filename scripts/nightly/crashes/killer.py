"""kill -9 at random, restart at once; now and then a worker is stopped past its lease and woken again.

Most kills are blind. Some wait for a moment that a blind one seldom meets: a file half written, or a probe of readiness
under way.
"""

import random
import threading
import time
from collections import Counter

from service.process import Process, Server

# Stopped longer than the lease of 10 s: its jobs are another's when it wakes.
PAST_THE_LEASE = 12.0
# So long between one kill and the next, seconds.
PAUSES = (0.1, 1.4)
# Of a hundred kills: so many at any time, while an artifact is half written, and while readiness is probed.
AIMS = {"blind": 50, "staging": 30, "probe": 20}
# How long a kill waits for its moment, seconds.
PATIENCE = 1.5
# Of the blind kills, so many are done by SIGTERM: a worker that hands its job back is a crash of its own kind.
POLITE = 0.08


class Killer:
    """Kills servers and workers until it has killed often enough."""

    def __init__(self, server: Server, workers: list[Process], seed: int, kills: int, stops: int):
        self.server, self.workers = server, workers
        self.draw = random.Random(seed)
        self.kills, self.stops = kills, stops
        self.done: Counter[str] = Counter()
        self.faults: list[str] = []
        self._held: set[int] = set()
        self._sleepers: list[threading.Thread] = []

    @property
    def killed(self) -> int:
        return self.done["server"] + self.done["worker"]

    def strike(self) -> None:
        """One kill, and the restart."""
        time.sleep(self.draw.uniform(*PAUSES))
        free = [worker for worker in self.workers if id(worker) not in self._held]
        victim = self.draw.choice([self.server, self.server, *free])
        kind = "server" if victim is self.server else "worker"
        if free and self.done["stopped"] < self.stops * (self.killed + 1) / self.kills:
            self._stop(self.draw.choice(free))
        if not victim.alive():
            self.faults.append(f"a {kind} had ended by itself ({victim.child.returncode})")
        aim = self.draw.choices(list(AIMS), weights=list(AIMS.values()))[0]
        if aim == "staging":
            self.done["while staging"] += self._until_staging()
        elif aim == "probe":
            self._while_probing()
            victim, kind = self.server, "server"
        if aim == "blind" and self.draw.random() < POLITE and victim.alive():
            self.done["terminated"] += 1
            if not victim.terminate(20.0):
                self.faults.append(f"a {kind} did not end within 20 s of SIGTERM")
        else:
            victim.kill()
        self.done[kind] += 1
        victim.start()

    def _until_staging(self) -> bool:
        """Waits for a file that is half written; whether one was seen."""
        until = time.monotonic() + PATIENCE
        attempts = self.server.data / "artifacts" / "attempts"
        while time.monotonic() < until:
            try:
                if next(attempts.rglob("*#*"), None):
                    return True
            except FileNotFoundError:
                # There is none yet, or one was renamed while we looked.
                time.sleep(0.002)
        return False

    def _while_probing(self) -> None:
        """Asks whether the server is ready, and comes back before it has answered."""

        def ask() -> None:
            try:
                self.server.connection(2.0).ask("GET", "/readyz")
            except OSError:
                pass

        threading.Thread(target=ask, daemon=True).start()
        time.sleep(self.draw.uniform(0.0, 0.03))

    def _stop(self, worker: Process) -> None:
        self._held.add(id(worker))
        self.done["stopped"] += 1
        worker.freeze()

        def wake() -> None:
            time.sleep(PAST_THE_LEASE)
            worker.thaw()
            time.sleep(0.5)
            self._held.discard(id(worker))

        sleeper = threading.Thread(target=wake, daemon=True)
        sleeper.start()
        self._sleepers.append(sleeper)

    def rest(self) -> None:
        """Waits until every stopped worker is awake."""
        for sleeper in self._sleepers:
            sleeper.join()
