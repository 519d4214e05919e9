"""Small jobs: a room of its own for every seed, three scans of it, some tens of milliseconds to fit."""

import math
import random


def _room(draw: random.Random) -> list[tuple[float, float]]:
    """The corners of an L: a rectangle without one of its corners."""
    width, height = draw.uniform(5.0, 8.0), draw.uniform(5.0, 8.0)
    inner_x, inner_y = width * draw.uniform(0.45, 0.6), height * draw.uniform(0.45, 0.6)
    return [(0, 0), (width, 0), (width, inner_y), (inner_x, inner_y), (inner_x, height), (0, height)]


def _range_to(walls: list, x: float, y: float, bearing: float) -> float | None:
    """How far it is to the nearest wall."""
    dx, dy = math.cos(bearing), math.sin(bearing)
    nearest = math.inf
    for (ax, ay), (bx, by) in walls:
        ex, ey = bx - ax, by - ay
        across = dx * ey - dy * ex
        if abs(across) < 1e-12:
            continue
        along = ((ax - x) * ey - (ay - y) * ex) / across
        share = ((ax - x) * dy - (ay - y) * dx) / across
        if along > 0 and 0 <= share <= 1:
            nearest = min(nearest, along)
    return nearest if math.isfinite(nearest) else None


def scan(draw: random.Random, corners: list, x: float, y: float, beams: int = 61) -> dict:
    """One scan of 240 degrees from a place, with the noise of experiment 1."""
    walls = list(zip(corners, corners[1:] + corners[:1], strict=True))
    theta, span = draw.uniform(-math.pi, math.pi), math.radians(240)
    ranges = []
    for k in range(beams):
        true = _range_to(walls, x, y, theta - span / 2 + k * span / (beams - 1))
        lost = true is None or draw.random() < 0.02
        ranges.append(None if lost else round(true + draw.gauss(0, 0.02), 4))
    return {
        "pose": {"x": x + draw.gauss(0, 0.01), "y": y + draw.gauss(0, 0.01), "theta": theta + draw.gauss(0, 0.005)},
        "angle_min": -span / 2,
        "angle_increment": span / (beams - 1),
        "range_min": 0.05,
        "range_max": 30.0,
        "ranges": ranges,
    }


def job(seed: int, resolution: float = 0.4, distance: str = "sdf", beams: int = 61) -> dict:
    """A job that is fitted without trouble."""
    draw = random.Random(seed)
    corners = _room(draw)
    (width, _), (_, height) = corners[1], corners[4]
    places = [(width * 0.2, height * 0.2), (width * 0.85, height * 0.15), (width * 0.15, height * 0.85)]
    return {
        "name": f"room {seed}",
        "scans": [scan(draw, corners, x, y, beams) for x, y in places],
        "noise": {"sigma_x": 0.01, "sigma_y": 0.01, "sigma_theta": 0.005, "sigma_range": 0.02},
        "map": {"distance": distance, "resolution": resolution},
    }
