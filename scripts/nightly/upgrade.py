#!/usr/bin/env python3
"""An older binary and a newer one on one database while jobs flow, as in a rolling update.

    scripts/nightly/upgrade.py --older mapfit-of-last-month --binary target/release/mapfit
    scripts/nightly/upgrade.py --older ... --binary ... --database-url postgres://USER@HOST/postgres

The older one serves and works. A worker of the newer joins, and brings the schema up to date. The older is killed and
starts again on that schema; then a server of the newer one comes beside it, and the older leaves. Meanwhile jobs are
submitted to whoever serves. All must end well, made by both; every map must be there and be the same at both servers.
An older binary is built from any commit: `git worktree add ../older COMMIT`, and there `cargo build --release`.
Exit code 1 where anything is otherwise.
"""

import argparse
import json
import re
import shutil
import sys
import tempfile
import time
from pathlib import Path

from crashes.records import Postgres, Records, Sqlite
from jobs import rooms
from service.bar import Bar
from service.process import Process, Server

# Jobs of each act.
JOBS = 60
WITHIN = 120.0
# Faults that are printed; the report has all.
SHOWN = 10


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--older", required=True)
    parser.add_argument("--binary", default="target/release/mapfit")
    parser.add_argument("--database-url", help="a PostgreSQL server, on which a database is made; SQLite otherwise")
    parser.add_argument("--json", type=Path, help="write a report there")
    return parser.parse_args()


class Rolling:
    """The processes, and what was asked of them."""

    def __init__(self, options: argparse.Namespace, folder: Path, records: Records):
        data, database = folder / "data", records.arguments
        self.records = records
        self.older = Server(options.older, data, 1, database)
        self.newer = Server(options.binary, data, 1, database)
        self.newer.log = folder / "newer.log"
        more = ["--data", data, "--workers", 1, "--log", "warn", *database]
        self.worker = Process([options.binary, "worker", *more], folder / "worker.log")
        self.jobs: list[str] = []
        self.migrations: list[int] = []
        self.ended: dict[str, int] = {}
        self.bar = Bar("jobs", 4 * JOBS)

    def submit(self, server: Server) -> None:
        """An act's jobs; some of them are running when the next act begins."""
        connection = server.connection()
        for _ in range(JOBS):
            answer = connection.ask("POST", "/v1/jobs", rooms.job(len(self.jobs), 0.3))
            if answer.status != 202:
                raise RuntimeError(f"a job was refused: {answer.status} {answer.body[:200]!r}")
            self.jobs.append(answer.json()["id"])
            self.bar.at(len(self.jobs))

    def acts(self) -> None:
        self.older.start()
        self.older.until_ready()
        self.submit(self.older)
        self.migrations.append(self.schema())
        self.worker.start()
        self.submit(self.older)
        time.sleep(2.0)
        self.migrations.append(self.schema())
        self.older.kill()
        self.older.start()
        self.older.until_ready()
        self.submit(self.older)
        self.newer.start()
        self.newer.until_ready()
        self.submit(self.newer)

    def schema(self) -> int:
        """How many migrations the database has had."""
        return self.records.rows("SELECT count(*) AS count FROM _sqlx_migrations")[0][0]

    def fitted(self) -> dict[str, int]:
        """How many jobs each server's own workers carried to their end, in its last life."""
        counts = {}
        for name, server in (("older", self.older), ("newer", self.newer)):
            told = server.connection().ask("GET", "/metrics").body.decode()
            found = re.search(r'^mapfit_attempts_total\{outcome="successful"\} (\d+)', told, re.MULTILINE)
            counts[name] = int(found[1]) if found else 0
        return counts

    def books(self) -> list[str]:
        """What is not as it should be."""
        asked, faults = self.newer.connection(WITHIN), []
        states = [asked.ask("GET", f"/v1/jobs/{job}?wait=60").json() for job in self.jobs]
        faults += [f"job {state['id']} is {state['status']}" for state in states if state["status"] != "successful"]
        older = self.older.connection(WITHIN)
        for state in states:
            path = f"/v1/maps/{state.get('map_id')}/coefficients?format=npz"
            answers = [server.ask("GET", path) for server in (older, asked)]
            if any(answer.status != 200 for answer in answers) or answers[0].body != answers[1].body:
                faults.append(f"{path}: {[answer.status for answer in answers]}, or not the same")
        self.ended = self.fitted()
        faults += [f"the {name} server ended no job" for name, count in self.ended.items() if count == 0]
        first, then, last = *self.migrations, self.schema()
        if first == then or then != last:
            faults.append(f"the worker did not bring the schema up to date: {first}, {then}, {last} migrations")
        if not self.worker.alive():
            faults.append("the worker has ended")
        if not self.older.terminate():
            faults.append("the older server does not end")
        for process in (self.older, self.newer, self.worker):
            faults += process.panics()
        return faults


def main() -> int:
    options = arguments()
    folder = Path(tempfile.mkdtemp(prefix="mapfit-upgrade-"))
    (folder / "data").mkdir()
    url = options.database_url
    records = Postgres(url, folder.name) if url else Sqlite(folder / "data")
    rolling = Rolling(options, folder, records)
    try:
        rolling.acts()
        faults = rolling.books()
    finally:
        for process in (rolling.older, rolling.newer, rolling.worker):
            process.kill()
    rolling.bar.end()
    report = {"jobs": len(rolling.jobs), "migrations": rolling.migrations, "fitted": rolling.ended, "faults": faults}
    print(json.dumps(report | {"faults": faults[:SHOWN]}))
    if options.json:
        options.json.write_text(json.dumps(report, indent=2))
    if not faults:
        records.drop()
        shutil.rmtree(folder)
    else:
        print(f"kept: {folder}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
