"""Maps: their records, the parts that are downloaded, and what is asked about them."""

import io
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..evaluation import FIELDS, VECTOR_FIELDS, Evaluation, as_points
from ..localization import LocalizedPose
from ..occupancy import OccupancyGrid
from ..recordings.jobs import as_scans, plain
from ..records import Distance, Kind, MapRecord, PosedScan
from ..wire.exchange import NPZ, Ask, Exchange, address, get_json, with_json

Part = Literal["coefficients", "surfaces", "propagated", "posterior"]
"""What a map is made of: the two last are the covariance by kind."""
PARTS: tuple[Part, ...] = ("coefficients", "surfaces", "propagated", "posterior")

_POINTS_AT_ONCE = 250_000


def get(map_id: str) -> Exchange[MapRecord]:
    """A map's record."""
    record: MapRecord = yield from get_json(address("maps", map_id))
    return record


def part(map_id: str, name: Part) -> Exchange[dict[str, NDArray[Any]]]:
    """A part of a map, its arrays by name."""
    if name in ("coefficients", "surfaces"):
        answer = yield Ask("GET", address("maps", map_id, name), headers=NPZ)
    else:
        params = {"form": "sparse", "kind": name}
        answer = yield Ask("GET", address("maps", map_id, "covariance"), params=params, headers=NPZ)
    return answer.arrays()


def query(map_id: str, distance: Distance, points: Any, kind: Kind) -> Exchange[Evaluation]:
    """What the service says about points, as many at a time as it takes."""
    flat, shape = as_points(points)
    names = FIELDS if distance == "sdf" else FIELDS + VECTOR_FIELDS
    params = {"kind": kind, "fields": ",".join(names)}
    headers = {"content-type": "application/x-npy", **NPZ}
    parts = []
    for start in range(0, len(flat), _POINTS_AT_ONCE):
        body = io.BytesIO()
        np.save(body, flat[start : start + _POINTS_AT_ONCE])
        answer = yield Ask("POST", address("maps", map_id, "query"), params, headers, body.getvalue())
        parts.append(answer.arrays())
    return Evaluation.joined(kind, distance, parts).shaped(shape)


def contours(map_id: str, level: float, sigma_band: float | None, kind: Kind) -> Exchange[dict[str, Any]]:
    """A level line of the distance as GeoJSON, and the band it lies in."""
    params = {"level": repr(float(level)), "kind": kind}
    if sigma_band is not None:
        params["sigma_band"] = repr(float(sigma_band))
    geojson: dict[str, Any] = yield from get_json(address("maps", map_id, "contours"), params)
    return geojson


def ogm(map_id: str, resolution: float | None, kind: Kind) -> Exchange[OccupancyGrid]:
    """The occupancy grid map."""
    return OccupancyGrid.of((yield from get_json(address("maps", map_id, "ogm"), _raster(resolution, kind))))


def grid(map_id: str, layers: Sequence[str], resolution: float | None, kind: Kind) -> Exchange[dict[str, NDArray[Any]]]:
    """Rasters by the layers' names, the lowest y first, with `origin` and `resolution`."""
    params = {**_raster(resolution, kind), "layers": ",".join(layers)}
    answer = yield Ask("GET", address("maps", map_id, "grid"), params, NPZ)
    return answer.arrays()


def poses(map_id: str) -> Exchange[list[PosedScan]]:
    """The poses as the fit has them."""
    record = yield from get_json(address("maps", map_id, "poses"))
    scans: list[PosedScan] = record["poses"]
    return scans


def changes(map_id: str, since: str, probability: float) -> Exchange[dict[str, Any]]:
    """What differs from another map, as GeoJSON."""
    params = {"since": since, "probability": repr(float(probability))}
    geojson: dict[str, Any] = yield from get_json(address("maps", map_id, "changes"), params)
    return geojson


def frames(map_id: str) -> Exchange[list[dict[str, Any]]]:
    """Where the frames of joined maps lie."""
    told: list[dict[str, Any]] = (yield from get_json(address("maps", map_id, "frames")))["frames"]
    return told


def localize(map_id: str, question: Mapping[str, Any]) -> Exchange[list[LocalizedPose]]:
    """Where scans were taken; members of the question that are None are left out."""
    asked = {name: plain(value) for name, value in question.items() if value is not None and name != "scans"}
    asked["scans"] = as_scans(question["scans"])
    answer = yield with_json("POST", address("maps", map_id, "localize"), asked, repeatable=True)
    return [LocalizedPose.of(pose) for pose in answer.json()["poses"]]


def delete(map_id: str) -> Exchange[None]:
    """Deletes a map and its arrays."""
    yield Ask("DELETE", address("maps", map_id), repeatable=False)


def _raster(resolution: float | None, kind: Kind) -> dict[str, str]:
    return {"kind": kind, **({} if resolution is None else {"resolution": repr(float(resolution))})}
