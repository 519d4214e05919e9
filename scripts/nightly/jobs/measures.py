"""Mutations of measures: the map's area and resolution, the noise, the fit's options."""

import random

from .geometry import scans_of

Document = dict


def bounds_somewhere(draw: random.Random, job: Document) -> None:
    if isinstance(job.get("map"), dict):
        low = [draw.choice([-1.0, 0.0, 2.0, -1e6, 4e6, 1e3]) for _ in range(2)]
        size = draw.choice([1e-6, 0.01, 0.5, 3.0, 8.0, 50.0, 1e6])
        job["map"]["bounds"] = {"min": low, "max": [low[0] + size, low[1] + size * draw.choice([1, 1, 10, 0.01])]}


def resolution(draw: random.Random, job: Document) -> None:
    if isinstance(job.get("map"), dict):
        job["map"]["resolution"] = draw.choice([1e-4, 0.01, 0.1, 0.25, 1.0, 3.0, 10.0, 100.0, 1e4])


def margin(draw: random.Random, job: Document) -> None:
    if isinstance(job.get("map"), dict):
        job["map"]["margin"] = draw.choice([0, 1e-12, 5, 30, 1e4])


def noise(draw: random.Random, job: Document) -> None:
    if isinstance(job.get("noise"), dict):
        value = draw.choice([1e-6, 1e-4, 1.0, 30.0, 1e3])
        for name in draw.sample(["sigma_x", "sigma_y", "sigma_theta", "sigma_range"], draw.choice([1, 2, 4])):
            job["noise"][name] = value


def covariance(draw: random.Random, job: Document) -> None:
    """Singular, nearly indefinite, or huge."""
    choices = [
        [0.0] * 9,
        [1e-4, 1e-4, 0, 1e-4, 1e-4, 0, 0, 0, 0],
        [1e-4, 0, 0, 0, 0, 0, 0, 0, 0],
        [0, 0, 0, 0, 0, 0, 0, 0, 1e-6],
        [1e6, 0, 0, 0, 1e6, 0, 0, 0, 1e6],
        [1e-300, 0, 0, 0, 1e-300, 0, 0, 0, 1e-300],
        [1, 1 + 1e-10, 0, 1 + 1e-10, 1, 0, 0, 0, 1],
        [1, 0.999999999, 0, 0.999999999, 1, 0, 0, 0, 1],
        [1e6, 0, 0, 0, 1e-12, 0, 0, 0, 1e-12],
    ]
    for scan in scans_of(job):
        scan["pose_covariance"] = list(draw.choice(choices))


def fit_options(draw: random.Random, job: Document) -> None:
    options = job.setdefault("fit", {})
    if not isinstance(options, dict):
        return
    name, values = draw.choice(
        [
            ("max_iterations", [1, 2, 1000]),
            ("tolerance", [1e-14, 1.0, 1e-3]),
            ("eikonal_weight", [1e-9, 1e9, 1.0]),
            ("eikonal_scale", [1e-9, 1e9]),
            ("smoothing", [0, 1e-9, 1e9]),
            ("model_sigma", [0, 1e-12, 1e3]),
            ("band", [0, 0.1, 3, 1e4]),
            ("poses", ["fixed", "refined"]),
            ("weighting", ["paper", "calibrated"]),
        ]
    )
    options[name] = draw.choice(values)


# Those that come twice are likelier.
MEASURES = [
    bounds_somewhere,
    bounds_somewhere,
    resolution,
    resolution,
    margin,
    noise,
    noise,
    covariance,
    covariance,
    fit_options,
    fit_options,
    fit_options,
]
