"""Jobs and maps copied in a database at rest, each under ids of its own: fitting as many would take hours and leave the same behind."""

import sqlite3
import time
import uuid
from pathlib import Path


def new_id(number: int) -> str:
    """A UUID of version 7 whose time is now, near enough."""
    milliseconds = int(time.time() * 1000)
    return str(uuid.UUID(int=milliseconds << 80 | 7 << 76 | 2 << 62 | number))


def copy_job(database: sqlite3.Connection, original: str, changes: dict) -> None:
    """A job's row and its request."""
    _copy(database, "jobs", original, changes)
    database.execute(
        "INSERT INTO requests (job_id, request) SELECT ?, request FROM requests WHERE job_id = ?",
        (changes["id"], original),
    )


def copy_map(database: sqlite3.Connection, artifacts: Path, original: sqlite3.Row, number: int, put) -> str:
    """A job (`job`) with its map (`map`) and the map's files under `prefix`; the copy's map id. `put` copies a file."""
    job, own = new_id(number), new_id(1_000_000 + number)
    copy_job(database, original["job"], {"id": job, "map_id": own})
    prefix = original["prefix"].replace(original["job"], job)
    _copy(database, "maps", original["map"], {"id": own, "job_id": job, "prefix": prefix})
    (artifacts / prefix).mkdir(parents=True)
    for file in (artifacts / original["prefix"]).iterdir():
        put(file, artifacts / prefix / file.name)
    return own


def maps_of(database: sqlite3.Connection) -> list[sqlite3.Row]:
    """What can be copied."""
    database.row_factory = sqlite3.Row
    return database.execute(
        "SELECT jobs.id AS job, maps.id AS map, maps.prefix AS prefix FROM maps JOIN jobs ON jobs.id = maps.job_id"
    ).fetchall()


def _copy(database: sqlite3.Connection, table: str, original: str, changes: dict) -> None:
    row = dict(database.execute(f"SELECT * FROM {table} WHERE id = ?", (original,)).fetchone()) | changes
    columns = ", ".join(row)
    marks = ", ".join("?" * len(row))
    database.execute(f"INSERT INTO {table} ({columns}) VALUES ({marks})", tuple(row.values()))
