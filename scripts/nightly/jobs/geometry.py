"""Mutations of what scans saw: legal geometry that is of no good to anybody."""

import copy
import math
import random

Document = dict


def scans_of(job: Document) -> list[dict]:
    """What is still a scan after earlier mutations."""
    scans = job.get("scans")
    wanted = {"ranges", "pose"}
    return [
        scan
        for scan in (scans if isinstance(scans, list) else [])
        if isinstance(scan, dict) and wanted <= scan.keys() and isinstance(scan["ranges"], list)
    ]


def one_return(draw: random.Random, job: Document) -> None:
    for scan in scans_of(job):
        scan["ranges"] = [None] * max(1, len(scan["ranges"]))
    for scan in scans_of(job)[:1]:
        scan["ranges"][draw.randrange(len(scan["ranges"]))] = draw.choice([2.0, 0.05, 30.0, 1e-3])


def equal_ranges(draw: random.Random, job: Document) -> None:
    value = draw.choice([0.0, 0.05, 2.0, 30.0])
    for scan in scans_of(job):
        scan["ranges"] = [value] * len(scan["ranges"])
        scan["range_min"] = 0.0


def equal_returns(draw: random.Random, job: Document) -> None:
    """All beams of all scans meet one point."""
    for scan in scans_of(job):
        scan |= {"pose": {"x": 1.0, "y": 1.0, "theta": 0.0}, "angle_increment": draw.choice([1e-12, 1e-300, 5e-324])}
        scan["ranges"] = [2.0] * max(1, len(scan["ranges"]))


def collinear(draw: random.Random, job: Document) -> None:
    """All returns lie on one line, exactly; poses on it, beside it, or far from it."""
    height, slope = draw.choice([1.0, 0.0, 1e-9, 1e3]), draw.choice([0.0, math.pi / 2, 0.3])
    for scan in scans_of(job):
        beams = draw.choice([2, 21, 200])
        scan |= {
            "pose": {"x": draw.choice([0.0, 1.0, 1e5]), "y": 0.0, "theta": slope},
            "angle_min": math.pi / 2 - 1.0,
            "angle_increment": 2.0 / beams,
        }
        scan["ranges"] = [height / math.sin(math.pi / 2 - 1.0 + k * 2.0 / beams) for k in range(beams)]
        scan["range_min"], scan["range_max"] = 0.0, 1e6


def axis_aligned(draw: random.Random, job: Document) -> None:
    """Returns at exact multiples of the resolution, along the axes alone."""
    for scan in scans_of(job):
        scan |= {
            "pose": {"x": 1.0, "y": 2.0, "theta": 0.0},
            "angle_min": -math.pi / 2,
            "angle_increment": math.pi / 2,
            "ranges": [1.0, 2.0, 1.0, 2.0],
        }


def same_scan_often(draw: random.Random, job: Document) -> None:
    for scan in scans_of(job)[:1]:
        job["scans"] = [copy.deepcopy(scan) for _ in range(draw.choice([2, 2, 30, 30, 100]))]


def thousands_of_one_beam(draw: random.Random, job: Document) -> None:
    scan = {"angle_min": 0.0, "angle_increment": draw.choice([0.0, 0.1]), "range_min": 0.05, "range_max": 30.0}
    job["scans"] = [
        scan
        | {
            "pose": {"x": draw.uniform(0, 5), "y": draw.uniform(0, 5), "theta": draw.uniform(-3, 3)},
            "ranges": [draw.uniform(0.1, 3)],
        }
        for _ in range(draw.choice([50] * 10 + [200] * 9 + [2000]))
    ]


def inside_out(draw: random.Random, job: Document) -> None:
    """Scans from behind the walls."""
    for scan in scans_of(job):
        if isinstance(scan["pose"], dict):
            scan["pose"] |= {"x": draw.uniform(-20, 20), "y": draw.uniform(-20, 20), "theta": draw.uniform(-1e6, 1e6)}


def noise_returns(draw: random.Random, job: Document) -> None:
    for scan in scans_of(job):
        scan["ranges"] = [draw.choice([None, draw.uniform(0, 30), draw.expovariate(1)]) for _ in scan["ranges"]]


def few_beams(draw: random.Random, job: Document) -> None:
    for scan in scans_of(job):
        scan["ranges"] = scan["ranges"][: draw.choice([1, 2, 3])]


def turned_back(draw: random.Random, job: Document) -> None:
    for scan in scans_of(job):
        if isinstance(scan.get("angle_increment"), float):
            scan["angle_increment"] *= -1


def far_away(draw: random.Random, job: Document) -> None:
    """The whole building at the other end of the world."""
    shift = draw.choice([1e3, 1e5, 9.9e5, -9.9e5])
    for scan in scans_of(job):
        if isinstance(scan["pose"], dict) and isinstance(scan["pose"].get("x"), float):
            scan["pose"]["x"] += shift


SCANS = [
    one_return,
    equal_ranges,
    equal_returns,
    collinear,
    axis_aligned,
    same_scan_often,
    thousands_of_one_beam,
    inside_out,
    noise_returns,
    few_beams,
    turned_back,
    far_away,
]
