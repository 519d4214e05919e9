"""The same jobs on a server that nobody kills: what every map must be, byte for byte.

Archives carry how long a fit took, so what is compared is each array's bytes.
"""

import hashlib
import io
import zipfile
from pathlib import Path

from service.connection import Connection
from service.process import Server

from .clients import until_empty
from .ledger import Entry

ARRAYS = (
    "coefficients?format=npz",
    "covariance?format=npz",
    "covariance?format=npz&kind=posterior",
    "covariance?form=sparse",
)


def arrays(connection: Connection, map_id: str | None) -> dict[str, str]:
    """Every array of a map by name, as the digest of its npy bytes; nothing where there is no map."""
    digests = {}
    for path in ARRAYS if map_id else ():
        answer = connection.ask("GET", f"/v1/maps/{map_id}/{path}")
        if answer.status != 200:
            raise OSError(f"{map_id}/{path}: {answer.status} {answer.body[:200]!r}")
        with zipfile.ZipFile(io.BytesIO(answer.body)) as archive:
            for name in archive.namelist():
                digests[f"{path} {name}"] = hashlib.sha256(archive.read(name)).hexdigest()
    return digests


def outcomes(binary: str, data: Path, entries: list[Entry], tell) -> dict[str, tuple[str, dict[str, str]]]:
    """By key: how the job ends when nobody interferes, and the arrays of its map."""
    server = Server(binary, data, workers=2)
    server.start()
    try:
        server.until_ready()
        connection = server.connection()
        ids = {entry.key: connection.ask("POST", "/v1/jobs", entry.document).json()["id"] for entry in entries}
        if not until_empty(connection, 1200, lambda left: tell(len(ids) - left)):
            raise RuntimeError(f"jobs do not end on a server that nobody kills; see {server.log}")
        ends = {key: connection.ask("GET", f"/v1/jobs/{job_id}").json() for key, job_id in ids.items()}
        return {key: (job["status"], arrays(connection, job["map_id"])) for key, job in ends.items()}
    finally:
        server.kill()


def compare(entries: list[Entry], connection: Connection, undisturbed: dict) -> tuple[dict[str, list[str]], int]:
    """The disturbed run's maps against the undisturbed ones, and how many were compared."""
    strange, different, compared = [], [], 0
    for entry in entries:
        job = connection.ask("GET", f"/v1/jobs/{entry.id}").json()
        expected, theirs = undisturbed[entry.key]
        problem = (job["problem"] or {}).get("type", "")
        if job["status"] == "dismissed" or problem.endswith("attempts-exhausted"):
            continue
        if job["status"] != expected:
            strange.append(f"{job['id']} is {job['status']} ({problem}), undisturbed {expected}")
        elif job["map_id"]:
            ours = arrays(connection, job["map_id"])
            compared += 1
            different += [
                f"{job['id']} {name}" for name in ours.keys() | theirs.keys() if ours.get(name) != theirs.get(name)
            ]
    return {"jobs end as undisturbed": strange, "maps are byte-identical": different}, compared
