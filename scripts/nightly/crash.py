#!/usr/bin/env python3
"""The crash suite: servers and workers are killed while jobs flow; then the books must balance.

    scripts/nightly/crash.py --binary target/release/mapfit --runs 10
    scripts/nightly/crash.py --binary target/release/mapfit --database-url postgres://USER@HOST/postgres

Each run submits its jobs with idempotency keys from several threads that retry through every outage. A killer sends
kill -9 (and now and then SIGTERM, or SIGSTOP past the lease) to the server and to the workers beside it. Then the
queue runs empty, the sweep runs, and the books are checked; see `crashes/books.py` for each check. Exit code 1 where
one fails.

On PostgreSQL every run has a database of its own, which it makes on the server that is named, and drops when its books
balance. With `--artifacts s3://BUCKET/PREFIX` every run has a prefix of its own there; a bucket is not searched for
orphans (tests/object_store.rs does that), but every map is read and compared.
"""

import argparse
import json
import shutil
import sys
import tempfile
import threading
import time
from pathlib import Path

from crashes import books, undisturbed
from crashes.clients import Clients, until_empty
from crashes.killer import Killer
from crashes.ledger import Ledger, plan
from crashes.records import Postgres, Records, Sqlite
from service.bar import Bar
from service.process import Process, Server, options_of


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", default="target/release/mapfit")
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--jobs", type=int, default=500, help="jobs a run")
    parser.add_argument("--kills", type=int, default=50, help="kills a run")
    parser.add_argument("--stops", type=int, default=3, help="workers stopped past their lease a run")
    parser.add_argument("--workers", type=int, default=2, help="`mapfit worker` processes; one may be stopped")
    parser.add_argument("--clients", type=int, default=6, help="submitting threads")
    parser.add_argument("--seed", type=int, default=1, help="of the first run; each run has the next")
    parser.add_argument("--server-args", default="", help="more arguments for serve, in one string")
    parser.add_argument("--database-url", help="a PostgreSQL server, on which runs make databases; SQLite otherwise")
    parser.add_argument(
        "--artifacts", help="s3://BUCKET/PREFIX, for serve and worker; a folder under the data otherwise"
    )
    parser.add_argument("--json", type=Path, help="write a report there")
    parser.add_argument(
        "--keep", action="store_true", help="keep every run's data; that of a failed one is always kept"
    )
    return parser.parse_args()


class Run:
    """One run: its processes, its clients, its killer, and its books."""

    def __init__(self, options: argparse.Namespace, seed: int):
        self.options, self.seed = options, seed
        self.folder = Path(tempfile.mkdtemp(prefix=f"mapfit-crash-{seed}-"))
        data = self.folder / "data"
        self.sweeps = "--sweep-seconds" in options_of(options.binary, "serve")
        # The folder's name is no other run's.
        own = self.folder.name.removeprefix("mapfit-").replace("-", "_")
        server = options.database_url
        self.records: Records = Postgres(server, f"mapfit_{own}") if server else Sqlite(data)
        shared = [*self.records.arguments]
        if options.artifacts:
            shared += ["--artifacts", f"{options.artifacts.rstrip('/')}/{own}"]
        if self.sweeps:
            shared += ["--sweep-seconds", "2"]
        more = [*shared, *options.server_args.split()]
        self.server = Server(options.binary, data, workers=1, more=more)
        command = [options.binary, "worker", "--data", data, "--workers", "1", "--log", "warn", *shared]
        self.workers = [Process(command, self.folder / f"worker-{k}.log") for k in range(options.workers)]
        self.ledger: Ledger = plan(seed, options.jobs)
        self.clients = Clients(self.ledger, self.server.port, options.clients)
        self.killer = Killer(self.server, self.workers, seed, options.kills, options.stops if self.workers else 0)

    def go(self) -> dict:
        began = time.monotonic()
        try:
            self._disturb()
            drained = time.monotonic()
            checks, figures = self._audit()
        finally:
            for process in [self.server, *self.workers]:
                process.thaw() if process.child else None
                process.kill()
        checks["no panic"] = self.server.panics() + [p for worker in self.workers for p in worker.panics()]
        checks["clients' answers"] = self.clients.faults
        checks["processes end when told, and only then"] = self.killer.faults
        broken = {name: found for name, found in checks.items() if found}
        kept = bool(broken) or self.options.keep
        if not kept:
            self.records.drop()
            shutil.rmtree(self.folder)
        return {
            "seed": self.seed,
            "kills": self.killer.killed,
            **dict(self.killer.done),
            "outages": self.clients.outages,
            "slowest_submission": round(self.clients.slowest, 2),
            "jobs": self.options.jobs,
            "found_again": sum(entry.found_again for entry in self.ledger.entries),
            **figures,
            "seconds_disturbed": round(drained - began, 1),
            "seconds": round(time.monotonic() - began, 1),
            "checks": len(checks),
            "broken": broken,
            "folder": str(self.folder) if kept else None,
        }

    def _disturb(self) -> None:
        """Jobs flow as kills do, so that the last kill meets work like the first; then the queue runs empty."""
        bar = Bar(f"run {self.seed}: kills", self.options.kills)
        self.server.start()
        self.server.until_ready()
        for worker in self.workers:
            worker.start()
        self.clients.start()
        released, entries = 0, self.ledger.entries
        while self.killer.killed < self.options.kills:
            due = len(entries) * (self.killer.killed + 1) // self.options.kills
            for entry in entries[released:due]:
                self.clients.release(entry)
            released = max(released, due)
            self.killer.strike()
            bar.at(self.killer.killed, f"{self.clients.submitted} submitted, {self.clients.outages} outages")
        bar.end()
        self.killer.rest()
        self.server.until_ready()
        self.clients.finish()
        if not until_empty(self.server.connection(), 300):
            self.killer.faults.append("the queue is not empty after 300 s")

    def _sweep(self) -> None:
        """Where the sweep cannot be hurried it comes with a start: all processes end, and the server starts again."""
        if self.sweeps:
            time.sleep(5)
            return
        for process in [*self.workers, self.server]:
            if not process.terminate(20.0):
                self.killer.faults.append("a process did not end within 20 s of SIGTERM at the end")
        self.server.start()
        self.server.until_ready()
        time.sleep(3)

    def _audit(self) -> tuple[dict[str, list[str]], dict]:
        self._sweep()
        connection = self.server.connection()
        checks, count = books.balance(self.ledger, connection)
        checks |= books.keys(self.ledger, connection)
        checks |= books.database(self.records)
        if not self.options.artifacts:
            checks |= books.artifacts(self.records, self.server.data / "artifacts")
        entries = [entry for entry in self.ledger.entries if entry.id and entry.kind != "cancelled"]
        bar = Bar(f"run {self.seed}: undisturbed", len(entries))
        expected = undisturbed.outcomes(self.options.binary, self.folder / "undisturbed", entries, bar.at)
        bar.end()
        same, compared = undisturbed.compare(entries, connection, expected)
        return checks | same, {**{name: count[name] for name in sorted(count)}, "maps_compared": compared}


def summary(report: dict) -> str:
    counts = ", ".join(f"{report.get(name, 0)} {name}" for name in ("successful", "failed", "dismissed"))
    more = f"{report.get('attempts exhausted', 0)} out of attempts, {report['maps_compared']} maps identical"
    verdict = (
        "balanced"
        if not report["broken"]
        else "NOT BALANCED: "
        + "; ".join(f"{name} ({len(found)}): {', '.join(found[:3])}" for name, found in report["broken"].items())
    )
    whole = f"run {report['seed']}: {report['jobs']} jobs = {counts}; {report['kills']} kills"
    return f"{whole}; {more}; {report['seconds']} s; {verdict}"


def main() -> int:
    options = arguments()
    reports = []
    # A thread that dies says so on stderr; a run does not hang for it, its clients' jobs are missing in the books.
    threading.excepthook = lambda failure: print(f"a thread died: {failure.exc_value!r}", file=sys.stderr)
    for seed in range(options.seed, options.seed + options.runs):
        reports.append(Run(options, seed).go())
        print(summary(reports[-1]), flush=True)
        if options.json:
            options.json.write_text(json.dumps(reports, indent=2))
    return 1 if any(report["broken"] for report in reports) else 0


if __name__ == "__main__":
    sys.exit(main())
