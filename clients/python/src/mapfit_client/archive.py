"""A map in one file: an npz with its record and its parts' arrays, which numpy opens, too.

The arrays are named `PART.ARRAY`: `coefficients.vdf_x`, `surfaces.ends`, `propagated.data` and so on, as the service
names them; `record` is the map's JSON, as bytes. Reading executes nothing.
"""

import json
import zipfile
from collections.abc import Mapping
from os import PathLike
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from .records import MapRecord
from .routes.maps import PARTS, Part

FORMAT = 1

Parts = dict[Part, dict[str, NDArray[Any]]]


def write(path: str | PathLike[str], record: MapRecord, parts: Mapping[Part, Mapping[str, NDArray[Any]]]) -> None:
    """Writes the file, replacing one that is there."""
    arrays: dict[str, NDArray[Any]] = {"format": np.array(FORMAT)}
    arrays["record"] = np.frombuffer(json.dumps(record).encode(), np.uint8)
    for part, own in parts.items():
        arrays |= {f"{part}.{name}": array for name, array in own.items()}
    # What numpy.savez_compressed writes, at the level at which a building takes a second instead of ten.
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, array, allow_pickle=False)


def read(path: str | PathLike[str]) -> tuple[MapRecord, Parts]:
    """Reads it again."""
    with np.load(path, allow_pickle=False) as archive:
        if "format" not in archive or "record" not in archive:
            raise ValueError(f"{path} is not a map that Map.save wrote")
        if (found := int(archive["format"])) != FORMAT:
            raise ValueError(f"{path} has format {found}, this version reads {FORMAT}")
        record: MapRecord = json.loads(archive["record"].tobytes())
        parts: Parts = {}
        for full in archive.files:
            part, _, name = full.partition(".")
            if name and part in PARTS:
                parts.setdefault(cast(Part, part), {})[name] = archive[full]
    return record, parts
