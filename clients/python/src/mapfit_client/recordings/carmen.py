"""CARMEN logs: `FLASER n r1..rn x y theta x y theta t host t`, metres and radians.

The first pose is the laser's, corrected. Beam i points at -90 degrees plus i steps; a scanner with 180 or 181 beams
has steps of 1 degree, one with 360 or 361 half a degree. Other lines are passed over. What a scanner writes for "no
return" differs from log to log: the largest values, where they are repeated as no measurement is, mean no return,
never a surface. This is how `mapfit submit` reads logs, too.
"""

import math
from typing import Any

import numpy as np

from ..spline.lattice import Floats

_STEPS = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5}
_RANGE_MIN = 0.05
"""A range below this is the scanner seeing itself."""
_REPEATED = 20
"""The largest values mean "no return" where they come this often, and more often than the next ten values together."""
_SPREAD = 0.1
"""How far apart the largest values may lie, metres."""


def parse_carmen(text: str) -> list[dict[str, Any]]:
    """The scans of a log, in the file's order, as a job has them."""
    lines = enumerate(text.splitlines(), start=1)
    scans = [_flaser(number, words[1:]) for number, line in lines if (words := line.split())[:1] == ["FLASER"]]
    if not scans:
        raise ValueError("the log has no FLASER line, so no scan; a job file ends in .json")
    every = np.concatenate([scan["ranges"] for scan in scans])
    none = _no_return_value(every)
    met = every if none is None else every[every < none]
    farthest = float(max(2 * _RANGE_MIN, met.max(initial=0.0)))
    for scan in scans:
        ranges = scan["ranges"]
        scan["range_max"] = farthest
        scan["ranges"] = [r if none is None or r < none else None for r in ranges.tolist()]
    return scans


def _flaser(number: int, words: list[str]) -> dict[str, Any]:
    beams = int(words[0]) if words and words[0].isdecimal() else 0
    if beams not in _STEPS:
        raise ValueError(f"line {number}: {' '.join(words[:1]) or 'no'} beams; 180, 181, 360 and 361 are known")
    try:
        numbers = np.array(words[1 : beams + 4], float)
    except ValueError as error:
        raise ValueError(f"line {number}: {error}") from None
    if len(numbers) < beams + 3 or not np.isfinite(numbers).all():
        raise ValueError(f"line {number}: {beams} ranges and a pose are wanted, all of them finite")
    x, y, theta = numbers[beams:].tolist()
    return {
        "pose": {"x": x, "y": y, "theta": _heading(theta)},
        "angle_min": -math.pi / 2,
        "angle_increment": math.radians(_STEPS[beams]),
        "range_min": _RANGE_MIN,
        "range_max": math.inf,
        "ranges": numbers[:beams],
    }


def _no_return_value(ranges: Floats) -> float | None:
    """The value from which ranges stand for "no return", where the log has one."""
    values, counts = np.unique(np.maximum(ranges, 0.0), return_counts=True)
    if not len(values):
        return None
    top = values >= values[-1] - _SPREAD
    count, following = counts[top].sum(), counts[~top][-10:].sum()
    return float(values[top][0]) if count >= _REPEATED and count > following else None


def _heading(theta: float) -> float:
    """In (-pi, pi], to a picoradian, as the command line has it."""
    wrapped = theta % math.tau
    if wrapped > math.pi:
        wrapped -= math.tau
    return math.copysign(math.floor(abs(wrapped) * 1e12 + 0.5), wrapped) / 1e12
