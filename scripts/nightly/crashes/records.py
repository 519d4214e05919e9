"""A run's database, as it lies there when all have done with it: read past the service.

Either kind is asked in SQL that both understand; where they keep their queue differently, each has a check of its own.
"""

import json
import os
import sqlite3
import subprocess
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import urlsplit, urlunsplit


class Records(Protocol):
    """What the books ask of a database, whichever it is."""

    #: For serve and worker alike.
    arguments: list[str]

    def rows(self, select: str) -> list[tuple[Any, ...]]:
        """What a query gives."""

    def damage(self) -> dict[str, list[str]]:
        """Where the database contradicts itself, by its own means."""

    def drop(self) -> None:
        """Leaves nothing behind."""


class Sqlite:
    """The file under a run's data, which goes with it."""

    arguments: list[str] = []

    def __init__(self, data: Path):
        self.file = data / "mapfit.sqlite"

    def rows(self, select: str) -> list[tuple[Any, ...]]:
        with sqlite3.connect(self.file) as database:
            return database.execute(select).fetchall()

    def damage(self) -> dict[str, list[str]]:
        broken = [row[0] for row in self.rows("PRAGMA integrity_check") if row[0] != "ok"]
        strays = [str(row) for row in self.rows("PRAGMA foreign_key_check")]
        turns = [str(row) for row in self.rows("SELECT tenant, priority, id FROM turns")]
        return {"the database is whole": broken + strays, "no turn without a job": turns}

    def drop(self) -> None:
        pass


class Postgres:
    """A database of the run's own on a server that is there; asked through `psql`, which comes with PostgreSQL."""

    def __init__(self, server: str, name: str):
        self.server, self.name = server, name
        self.url = urlunsplit(urlsplit(server)._replace(path=f"/{name}"))
        self.arguments = ["--database-url", self.url]
        _psql(server, f'CREATE DATABASE "{name}"')

    def rows(self, select: str) -> list[tuple[Any, ...]]:
        said = _psql(self.url, f"SELECT coalesce(json_agg(found), '[]') FROM ({select}) AS found")
        return [tuple(row.values()) for row in json.loads(said)]

    def damage(self) -> dict[str, list[str]]:
        held = self.rows("SELECT job_id, attempt FROM leases")
        counted = self.rows("SELECT sum(queued) AS queued, sum(maps) AS maps, sum(bytes) AS bytes FROM holdings")
        there = self.rows("""SELECT (SELECT count(*) FROM jobs WHERE status = 'accepted') AS queued,
                                    count(*) AS maps, sum(bytes) AS bytes FROM maps""")
        return {
            "no lease without a running job": [str(row) for row in held],
            "what tenants hold is counted": [f"{counted}, but there are {there}"] * (counted != there),
        }

    def drop(self) -> None:
        _psql(self.server, f'DROP DATABASE "{self.name}" WITH (FORCE)')


def _psql(url: str, statement: str) -> str:
    """What psql answers to one statement, without ornament."""
    folder = os.environ.get("MAPFIT_POSTGRES")
    program = str(Path(folder) / "psql") if folder else "psql"
    command = [
        program,
        "--no-psqlrc",
        "--no-align",
        "--tuples-only",
        "--set=ON_ERROR_STOP=1",
        f"--command={statement}",
        url,
    ]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError(f"psql {urlsplit(url).path}: {done.stderr.strip()}")
    return done.stdout
