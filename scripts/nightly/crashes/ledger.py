"""What clients were promised, in their own handwriting: nothing here comes from the service's store."""

import random
import threading
from dataclasses import dataclass, field

from jobs import rooms

ENDED = ("successful", "failed", "dismissed")
# Of a hundred jobs: so many plain ones, labelled ones, cancelled ones, and ones that fail.
KINDS = {"plain": 50, "labelled": 25, "cancelled": 15, "poisoned": 10}


@dataclass
class Entry:
    """One job, from the client's side of the wire."""

    key: str
    kind: str
    document: dict
    cancel_after: float = 0.0
    id: str | None = None
    #: An answer said that it was cancelled (200), not only that it had ended (409).
    dismissed: bool = False
    #: The first end that any answer told of: (status, map_id). It must never change.
    seen_end: tuple[str, str | None] | None = None
    #: Whether the first answer that came told of an earlier, lost one (200 instead of 202).
    found_again: bool = False


@dataclass
class Ledger:
    """Every job of a run, and what answers contradicted an earlier answer."""

    entries: list[Entry]
    contradictions: list[str] = field(default_factory=list)
    lock: threading.Lock = field(default_factory=threading.Lock)

    def accepted(self, entry: Entry, job: dict, again: bool) -> None:
        with self.lock:
            if entry.id is None:
                entry.id, entry.found_again = job["id"], again
            elif entry.id != job["id"]:
                self.contradictions.append(f"key {entry.key} is job {entry.id} and job {job['id']}")

    def saw(self, entry: Entry, job: dict) -> None:
        """Notes a job's state where it is an end, and whether it contradicts an end seen before."""
        if job["status"] not in ENDED:
            if entry.seen_end:
                self.contradictions.append(f"{entry.id} was {entry.seen_end[0]} and is {job['status']} again")
            return
        end = (job["status"], job["map_id"])
        with self.lock:
            if entry.seen_end is None:
                entry.seen_end = end
            elif entry.seen_end != end:
                self.contradictions.append(f"{entry.id} ended as {entry.seen_end} and later as {end}")


def plan(run_seed: int, jobs: int) -> Ledger:
    """The jobs of a run; the same seed gives the same jobs."""
    draw = random.Random(run_seed)
    kinds = draw.choices(list(KINDS), weights=list(KINDS.values()), k=jobs)
    entries = []
    for number, kind in enumerate(kinds):
        seed = run_seed * 100_000 + number
        distance = draw.choice(["sdf", "sdf", "vdf"])
        document = rooms.job(seed, draw.choice([0.25, 0.3, 0.4, 0.5]), distance)
        if kind == "labelled":
            document["labels"] = {"run": str(run_seed), "site": draw.choice(["hq", "lab", "Ω: 2"])}
        if kind == "poisoned":
            # One return says too little to determine a map: it fails at once, and is not tried again.
            for scan in document["scans"]:
                scan["ranges"] = [None] * len(scan["ranges"])
            document["scans"][0]["ranges"][5] = 2.0
        document["priority"] = draw.choice([0, 0, 0, 5, -5])
        wait = draw.choice([0.0, 0.05, 0.3, 1.5])
        entries.append(Entry(f"crash-{run_seed}-{number}", kind, document, wait))
    return Ledger(entries)
