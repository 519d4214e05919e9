"""A world of straight walls, and a scanner in it."""

import math
from itertools import pairwise
from typing import Any

import numpy as np

from mapfit_client.records import Distance
from mapfit_client.spline.lattice import Floats

NOISE = {"sigma_x": 0.01, "sigma_y": 0.01, "sigma_theta": 0.005, "sigma_range": 0.02}
OUTLINE = [(0, 0), (6, 0), (6, 4), (0, 4), (0, 0)]
DIVIDER = [[(3, 0), (3, 1.5)], [(3, 2.5), (3, 4)]]
BEAMS = 181


def rooms(distance: Distance, seed: int = 1) -> dict[str, Any]:
    """A job: for a vector map a thin wall with a door stands in the middle."""
    pairs = list(pairwise(OUTLINE)) + ([] if distance == "sdf" else [tuple(w) for w in DIVIDER])
    walls = np.array(pairs, float)
    random = np.random.default_rng(seed)
    poses = [(1.2, 1.0, 0.6), (4.8, 1.1, 2.4), (4.5, 3.0, -2.2), (1.4, 3.1, -0.8)]
    return {
        "name": f"rooms, {distance}",
        "labels": {"world": "rooms", "distance": distance},
        "scans": [_scan(walls, pose, random) for pose in poses],
        "noise": NOISE,
        "map": {"distance": distance, "resolution": 0.25},
    }


def tiny(seed: int = 1, **members: Any) -> dict[str, Any]:
    """A job that takes some milliseconds."""
    job = rooms("sdf", seed)
    return job | {"scans": job["scans"][:2], "map": {"distance": "sdf", "resolution": 1.0}} | members


def _scan(walls: Floats, pose: tuple[float, float, float], random: np.random.Generator) -> dict[str, Any]:
    x, y, theta = np.array(pose) + random.normal(0, [0.01, 0.01, 0.005])
    bearings = np.linspace(-math.pi / 2, math.pi / 2, BEAMS)
    ranges = _ranges(walls, np.array(pose[:2]), pose[2] + bearings) + random.normal(0, 0.02, BEAMS)
    ranges[::40] = np.nan
    return {
        "pose": {"x": x, "y": y, "theta": theta},
        "angle_min": -math.pi / 2,
        "angle_increment": math.pi / (BEAMS - 1),
        "range_min": 0.05,
        "range_max": 30.0,
        "ranges": ranges,
    }


def _ranges(walls: Floats, center: Floats, angles: Floats) -> Floats:
    """How far it is to the nearest wall along each angle."""
    beams = np.stack([np.cos(angles), np.sin(angles)], axis=-1)[:, None]
    span, offset = walls[:, 1] - walls[:, 0], walls[:, 0] - center
    across = _cross(beams, span)
    with np.errstate(divide="ignore", invalid="ignore"):
        along_beam, along_wall = _cross(offset, span) / across, _cross(offset, beams) / across
    met = (along_beam > 0) & (along_wall >= 0) & (along_wall <= 1)
    nearest: Floats = np.where(met, along_beam, np.inf).min(axis=1)
    return nearest


def _cross(a: Floats, b: Floats) -> Floats:
    product: Floats = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product
