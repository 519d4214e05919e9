"""A job from a document or a file.

A file is a job's JSON or a CARMEN log, either of them gzipped or not. Arrays of numpy are taken anywhere; a range
that is NaN or infinite is no return, null.
"""

import gzip
import json
import math
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..records import Distance
from .carmen import parse_carmen

NOISE = {"sigma_x": 0.02, "sigma_y": 0.02, "sigma_theta": 0.005, "sigma_range": 0.02}
"""What a log's poses and ranges are taken to be worth: metres, radians. As `mapfit submit` has it."""


def as_job(job: Mapping[str, Any] | str | PathLike[str]) -> dict[str, Any]:
    """The job that a document is, or that a file holds or means."""
    if isinstance(job, Mapping):
        scans = {"scans": as_scans(job["scans"])} if "scans" in job else {}
        return {name: plain(member) for name, member in job.items() if name != "scans"} | scans
    path = Path(job)
    stem = path.name.removesuffix(".gz")
    if stem.endswith(".json"):
        document = json.loads(_unpacked(path))
        if not isinstance(document, Mapping):
            raise ValueError(f"{path}: a job is an object of JSON")
        return as_job(document)
    if stem.endswith((".mcap", ".bag")):
        raise ValueError(f"{path}: recordings are read by `mapfit submit {path}`, not by this client")
    return log_to_job(path)


def log_to_job(
    path: str | PathLike[str],
    *,
    distance: Distance = "vdf",
    resolution: float = 0.25,
    noise: Mapping[str, float] | None = None,
    every: int = 1,
    start: int = 0,
    stop: int | None = None,
) -> dict[str, Any]:
    """A CARMEN log as a job: every so many scans from `start` up to `stop`; `noise` names what differs from `NOISE`."""
    path = Path(path)
    try:
        scans = parse_carmen(_unpacked(path).decode(errors="replace"))[start:stop:every]
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    if not scans:
        raise ValueError(f"{path}: start, stop and every leave no scan")
    return {
        "name": path.name.removesuffix(".gz").removesuffix(".log"),
        "scans": scans,
        "noise": {**NOISE, **(noise or {})},
        "map": {"distance": distance, "resolution": resolution},
    }


def plain(value: Any) -> Any:
    """A value with lists and numbers of Python's own."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {name: plain(member) for name, member in value.items()}
    return [plain(member) for member in value] if isinstance(value, list | tuple) else value


def as_scans(scans: Any) -> Any:
    """Scans as a job has them: what is no return is null."""
    scans = plain(scans)
    return [_scan(scan) for scan in scans] if isinstance(scans, list) else scans


def _scan(scan: Any) -> Any:
    if not (isinstance(scan, dict) and isinstance(scan.get("ranges"), list)):
        return scan
    ranges = [None if isinstance(r, float) and not math.isfinite(r) else r for r in scan["ranges"]]
    return {**scan, "ranges": ranges}


def _unpacked(path: Path) -> bytes:
    content = path.read_bytes()
    return gzip.decompress(content) if content.startswith(b"\x1f\x8b") else content
