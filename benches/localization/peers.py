"""Other ways to find a pose, on the cases that `examples/localization.rs --write FILE` wrote: same scans of the map, same starts.

    peers.py FILE... [--csv OUT]

- *grid*: Gauss-Newton on the distance transform of a 5 cm grid of the map's returns (Geman and McClure's loss, coarse to
  fine, as ours has it; the prior as a term), with the covariance of its normal equations.
- *amcl*: PyPI's `amcl`, a particle filter with the likelihood field of Nav2 and Player; the scan is shown to it `LOOKS`
  times, the robot standing still, and pose and covariance are its particles'.

Nobody is told more than the others. A failure is 0.5 m or 10 degrees; coverage is how many truths lie in the 95 % ellipsoid.
"""

import json
import sys
import time

import numpy as np
from scipy.ndimage import distance_transform_edt, map_coordinates

CELL = 0.05
STAGES = [(0.5, 6), (0.2, 6), (0.08, 6), (0.03, 6), (0.0, 20)]
BULK = 9.0
LOOKS = 8
WITHIN = 7.815
HEADINGS = ["case", "method", "scans", "nowhere", "failed", "median_mm", "rms_mm", "p95_mm", "covered", "ms"]


def returns(scan):
    """Bearings and ranges of a scan's returns."""
    ranges = np.array([np.nan if r is None else r for r in scan["ranges"]])
    bearings = scan["angle_min"] + scan["angle_increment"] * np.arange(len(ranges))
    held = np.isfinite(ranges) & (ranges >= scan["range_min"]) & (ranges <= scan["range_max"])
    return bearings[held], ranges[held]


def placed(pose, bearings, ranges):
    angle = pose[2] + bearings
    return np.stack([pose[0] + ranges * np.cos(angle), pose[1] + ranges * np.sin(angle)], axis=1)


class Grid:
    """Returns on a grid of 5 cm, and how far the nearest is."""

    def __init__(self, scans):
        points = np.concatenate([placed(scan["pose"], *returns(scan)) for scan in scans])
        self.low = points.min(axis=0) - 2.0
        size = np.ceil((points.max(axis=0) + 2.0 - self.low) / CELL).astype(int)
        self.met = np.zeros((size[1], size[0]), dtype=bool)
        at = ((points - self.low) / CELL).astype(int)
        self.met[at[:, 1], at[:, 0]] = True
        self.distance = CELL * distance_transform_edt(~self.met)
        self.slope = np.gradient(self.distance, CELL)

    def at(self, points):
        """Distance and its gradient, between the cells' centres bilinear."""
        place = ((points - self.low) / CELL - 0.5).T[::-1]
        read = lambda field: map_coordinates(field, place, order=1, mode="nearest")
        return read(self.distance), np.stack([read(self.slope[1]), read(self.slope[0])], axis=1)


def gauss_newton(grid, scan, start, prior, sigma_range):
    bearings, ranges = returns(scan)
    pose, information = np.array(start), np.linalg.inv(np.diag(prior))
    floor = sigma_range**2 + CELL**2 / 12.0
    for scale, steps in STAGES:
        for _ in range(steps):
            points = placed(pose, bearings, ranges)
            value, slope = grid.at(points)
            weight = (1.0 + value**2 / (floor + scale**2) / BULK) ** -2 / (floor + scale**2)
            arm = points - pose[:2]
            rows = np.column_stack([slope, slope[:, 1] * arm[:, 0] - slope[:, 0] * arm[:, 1]])
            off = pose - start
            off[2] = (off[2] + np.pi) % (2 * np.pi) - np.pi
            normal = rows.T @ (weight[:, None] * rows) + information
            step = np.linalg.solve(normal, rows.T @ (weight * value) + information @ off)
            pose = pose - step
            if np.abs(step).max() < 1e-6:
                break
    return pose, np.linalg.inv(normal)


class Particles:
    def __init__(self, grid):
        import amcl

        self.amcl = amcl
        cells = np.where(grid.met, 100, 0).astype(int).tolist()
        self.map = amcl.create_occupancy_grid_from_list(cells, CELL, *grid.low)

    def located(self, scan, start, prior):
        amcl = self.amcl
        still = amcl.MotionParameters(0.05, 0.05, 0.05, 0.05, 0.05)
        laser = amcl.LaserParameters(0.9, 0.05, 0.0, 0.05, 0.1, 0.1, 0.0, 60)
        own = amcl.AMCL(500, 2000, 0.0, 0.0, still, laser, "omni")
        own.set_map(self.map)
        own.set_laser_pose(amcl.Vector3D(0.0, 0.0, 0.0))
        own.set_initial_pose(amcl.Vector3D(*start), amcl.create_diagonal_covariance(*prior))
        bearings, ranges = returns(scan)
        beams = amcl.create_laser_scan_from_list(np.column_stack([ranges, bearings]).tolist(), scan["range_max"])
        for _ in range(LOOKS):
            own.update(beams, amcl.Vector3D(*start))
        return np.array(own.get_pose_mean().v), np.array(own.get_pose_covariance().to_list())


def summary(case, method, found, truths, seconds):
    """A line of the table; `found` holds a pose and a covariance a scan, or None."""
    errors, failed, covered = [], 0, 0
    for own, truth in zip(found, truths):
        if own is None:
            continue
        off = np.array(own[0]) - truth
        off[2] = (off[2] + np.pi) % (2 * np.pi) - np.pi
        errors.append(np.hypot(*off[:2]))
        failed += errors[-1] > 0.5 or abs(off[2]) > np.radians(10)
        spread = np.array(own[1]).reshape(3, 3)
        if np.linalg.matrix_rank(spread) == 3:
            covered += off @ np.linalg.solve(spread, off) <= WITHIN
    errors = 1e3 * np.array(errors)
    return dict(
        zip(
            HEADINGS,
            [case, method, len(truths), len(truths) - len(errors), int(failed)]
            + [f"{value:.0f}" for value in (np.median(errors), np.sqrt((errors**2).mean()), np.percentile(errors, 95))]
            + [f"{covered / len(errors):.2f}", f"{1e3 * seconds / len(truths):.1f}"],
        )
    )


def judged(file, done):
    """Lines of the table; what is in `done`, case and method, is not done again: files may differ in our map alone."""
    told = json.load(open(file))
    grid = Grid(told["map"])
    particles = Particles(grid)
    for case in told["cases"]:
        truths = [np.array(own["truth"]) for own in case["scans"]]
        ours = [own["ours"] and (own["ours"]["pose"], own["ours"]["covariance"]) for own in case["scans"]]
        yield summary(case["name"], told["method"], ours, truths, case["seconds"])
        for method, locate in [
            ("grid", lambda own: gauss_newton(grid, own["scan"], own["start"], case["prior"], told["sigma_range"])),
            ("amcl", lambda own: particles.located(own["scan"], own["start"], case["prior"])),
        ]:
            if (case["name"], method) in done:
                continue
            done.add((case["name"], method))
            began = time.perf_counter()
            found = []
            for k, own in enumerate(case["scans"]):
                print(f"\r{case['name']} {method} {k + 1}/{len(truths)}  ", end="", file=sys.stderr)
                found.append(locate(own))
            yield summary(case["name"], method, found, truths, time.perf_counter() - began)
        print(file=sys.stderr)


def main():
    arguments = sys.argv[1:]
    out = open(arguments.pop(arguments.index("--csv") + 1), "w") if "--csv" in arguments else sys.stdout
    print(",".join(HEADINGS), file=out)
    done = set()
    for file in (own for own in arguments if own != "--csv"):
        for line in judged(file, done):
            print(",".join(str(line[name]) for name in HEADINGS), file=out, flush=True)


main()
