"""The books after a run: what clients were promised against what the service has.

Each check is a name and what contradicts it; an empty list is a check that holds.
"""

import json
from collections import Counter
from pathlib import Path

from service.connection import Connection

from .ledger import ENDED, Ledger
from .records import Records


def balance(ledger: Ledger, connection: Connection) -> tuple[dict[str, list[str]], Counter]:
    """Jobs and maps by HTTP."""
    jobs = connection.pages("/v1/jobs")
    maps = connection.pages("/v1/maps")
    by_id = {job["id"]: job for job in jobs}
    accepted = {entry.id: entry for entry in ledger.entries if entry.id}
    for entry in accepted.values():
        if entry.id in by_id:
            ledger.saw(entry, by_id[entry.id])
    count = Counter(job["status"] for job in jobs)
    maps_of = Counter(one["job_id"] for one in maps)
    with_map = {job["id"] for job in jobs if job["status"] == "successful"}
    checks = {
        "every job was accepted": [e.key for e in ledger.entries if not e.id],
        "accepted jobs are there": [i for i in accepted if i not in by_id],
        "each is there once": [i for i, n in Counter(job["id"] for job in jobs).items() if n > 1],
        "no job nobody submitted": [i for i in by_id if i not in accepted],
        "every job has ended": [i for i, job in by_id.items() if job["status"] not in ENDED],
        "accepted = successful + failed + dismissed": (
            [] if len(accepted) == sum(count[s] for s in ENDED) else [f"{len(accepted)} are not {dict(count)}"]
        ),
        "ends do not change": list(ledger.contradictions),
        "a cancellation holds": [
            e.id for e in accepted.values() if e.dismissed and by_id.get(e.id, {}).get("status") != "dismissed"
        ],
        "nobody else is dismissed": [
            e.id
            for e in accepted.values()
            if e.kind != "cancelled" and by_id.get(e.id, {}).get("status") == "dismissed"
        ],
        "a successful job has one map": [i for i in with_map if maps_of[i] != 1],
        "a map has one successful job": [m["id"] for m in maps if m["job_id"] not in with_map],
        "job and map name each other": [m["id"] for m in maps if by_id.get(m["job_id"], {}).get("map_id") != m["id"]],
        "only successful jobs name a map": [j["id"] for j in jobs if j["map_id"] and j["status"] != "successful"],
        "failed jobs say why": [j["id"] for j in jobs if (j["status"] == "failed") != (j["problem"] is not None)],
        "labels and names are kept": [
            e.id
            for e in accepted.values()
            if e.id in by_id
            and (by_id[e.id]["labels"], by_id[e.id]["name"]) != (e.document.get("labels", {}), e.document["name"])
        ],
    }
    count["attempts exhausted"] = sum(
        1 for job in jobs if job["problem"] and job["problem"]["type"].endswith("attempts-exhausted")
    )
    count["begun again"] = sum(1 for job in jobs if job["attempt"] > 1)
    return checks, count


def keys(ledger: Ledger, connection: Connection) -> dict[str, list[str]]:
    """Each key still finds its job, and every label its jobs."""
    strange = []
    for entry in ledger.entries:
        answer = connection.ask("POST", "/v1/jobs", entry.document, {"idempotency-key": entry.key})
        if answer.status != 200 or answer.json()["id"] != entry.id:
            strange.append(f"{entry.key}: {answer.status} {answer.body[:120]!r}")
    lost = []
    labelled = [entry for entry in ledger.entries if entry.document.get("labels") and entry.id]
    for run in {entry.document["labels"]["run"] for entry in labelled}:
        found = {job["id"] for job in connection.pages(f"/v1/jobs?label=run:{run}")}
        lost += [entry.id for entry in labelled if entry.id not in found]
    return {"a key finds its job": strange, "a label finds its jobs": lost}


def artifacts(records: Records, root: Path) -> dict[str, list[str]]:
    """The folder against the maps' rows; both as they lie on disk."""
    prefixes = {row[0] for row in records.rows("SELECT prefix FROM maps")}
    wanted = {root / prefix / "map.npz" for prefix in prefixes}
    there = {path for path in root.rglob("*") if path.is_file()}
    needed = {folder for path in wanted for folder in path.parents}
    folders = {path for path in root.rglob("*") if path.is_dir()}

    def short(paths: set[Path]) -> list[str]:
        return sorted(str(path.relative_to(root)) for path in paths)

    orphans = there - wanted
    staged = {path for path in orphans if "#" in path.name}
    return {
        "every map's file is there": short(wanted - there),
        "no orphan file": short(orphans - staged),
        "no staging file": short(staged),
        "no empty folder": short({f for f in folders - needed if not any(f.iterdir())}),
        "no folder of a lost attempt": short({f for f in folders - needed if any(f.iterdir())}),
    }


def database(records: Records) -> dict[str, list[str]]:
    """The database itself: whole, and its indexes by trigger agree with the rows."""
    wrong = []
    for table, labels, named in (("jobs", "job_labels", "job_id"), ("maps", "map_labels", "map_id")):
        said = {
            (row[0], key, value)
            for row in records.rows(f"SELECT id, labels FROM {table}")
            for key, value in json.loads(row[1]).items()
        }
        kept = set(records.rows(f"SELECT {named}, key, value FROM {labels}"))
        wrong += [f"{labels}: {one}" for one in said ^ kept]
    bare = [row[0] for row in records.rows("SELECT id FROM jobs WHERE id NOT IN (SELECT job_id FROM requests)")]
    return {**records.damage(), "labels agree with their index": wrong, "every job has its request": bare}
