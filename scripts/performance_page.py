"""docs/performance.md from what scripts/peers measured: docs/performance/*.csv."""

import csv
import glob
import math
import os
import statistics
import sys

import matplotlib

matplotlib.use("svg")
matplotlib.rcParams["svg.hashsalt"] = "mapfit"
import matplotlib.pyplot as plt

FOLDER = os.path.join(os.path.dirname(__file__), "..", "docs", "performance")
NAMES = {"mapfit": "mapfit", "ceres": "Ceres 2.1", "trf": "SciPy trf, LSMR", "splu": "LM on scipy's splu"}
WORLDS = {"L": "L-room, 2,401", "office10k": "office, 10,816", "office40k": "office, 41,616"}
LARGEST = {"office160k": "office, 163,216"}


def trace(file):
    """(seconds, lowest cost so far) a step, and the comments."""
    steps, comments, lowest = [], [], math.inf
    for line in open(file):
        if line.startswith("#"):
            comments.append(line[1:].strip())
        elif line[0].isdigit():
            seconds, cost, _ = line.split(",")
            lowest = min(lowest, float(cost))
            steps.append((float(seconds), lowest))
    return steps, comments


def seconds_to(steps, cost):
    return next((seconds for seconds, lowest in steps if lowest <= cost), math.inf)


def shown(seconds):
    return "never" if math.isinf(seconds) else f"{seconds:.2f} s"


def relative_gradient(file):
    """The gradient at the end over the start's: mapfit's column, the ratio of Ceres's, SciPy's closing line."""
    lines = open(file).read().splitlines()
    closing = [line.split()[-1] for line in lines if line.startswith("# relative gradient")]
    if closing:
        return float(closing[0])
    column = [float(line.split(",")[2]) for line in lines if line[0].isdigit()]
    return column[-1] / column[0]


def race():
    lines = ["| lattice | solver | to 1 % of the best cost | final cost | steps | relative gradient |", "| --- | --- | --- | --- | --- | --- |"]
    figure, axes = plt.subplots(1, 3, figsize=(13, 3.8))
    for axis, (world, label) in zip(axes, WORLDS.items()):
        runs = {}
        for solver in NAMES:
            files = sorted(glob.glob(f"{FOLDER}/{world}.{solver}.*.csv"))
            runs[solver] = [trace(file) for file in files]
        runs = {solver: own for solver, own in runs.items() if own}
        if not runs:
            continue
        best = min(steps[-1][1] for own in runs.values() for steps, _ in own)
        for solver, own in runs.items():
            time = statistics.median(seconds_to(steps, 1.01 * best) for steps, _ in own)
            steps, _ = own[0]
            gradient = relative_gradient(f"{FOLDER}/{world}.{solver}.1.csv")
            lines.append(f"| {label} | {NAMES[solver]} | {shown(time)} | {steps[-1][1]:.2f} | {len(steps) - 1} | {gradient:.0e} |")
            axis.semilogx(*zip(*[(max(s, 1e-3), c / best) for s, c in steps]), label=NAMES[solver])
        axis.axhline(1.01, color="grey", linewidth=0.6)
        axis.set(title=label + " control points", xlabel="seconds", ylabel="cost over the best", ylim=(0.98, 1.8))
    axes[0].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(f"{FOLDER}/race.svg", metadata={"Date": None})
    return "\n".join(lines)


def marginals():
    lines = ["| lattice | factorisation | posterior marginals | both kinds | in factorisations |", "| --- | --- | --- | --- | --- |"]
    for world, label in (WORLDS | LARGEST).items():
        files = sorted(glob.glob(f"{FOLDER}/{world}.ma*.csv"))
        words = [c.split() for file in files for c in trace(file)[1] if c.startswith("marginals")]
        if words:
            factor, posterior, both = (statistics.median(float(w[k]) for w in words) for k in (2, 4, 6))
            lines.append(f"| {label} | {1e3 * factor:.1f} ms | {1e3 * posterior:.1f} ms | {1e3 * both:.1f} ms | {posterior / factor:.1f} and {both / factor:.1f} |")
    lines.append("\nCeres's Covariance (SPARSE_QR, the diagonal alone), and all marginals of arael 0.9.3 (its assembly and factorisation included), on one core:\n")
    for world, label in WORLDS.items():
        peers = []
        for file in glob.glob(f"{FOLDER}/{world}.covariance.csv"):
            words = open(file).read().split()[2:]
            peers.append("Ceres " + (f"{float(words[0]):.1f} s" if words[-1] == "ok" else " ".join(words)))
        for file in glob.glob(f"{FOLDER}/{world}.arael.csv"):
            peers.append(f"arael {float(open(file).read().split()[6]):.2f} s")
        if peers:
            lines.append(f"- {label}: " + ", ".join(peers))
    return "\n".join(lines)


def truth():
    lines = []
    for world, label in WORLDS.items():
        for file in sorted(glob.glob(f"{FOLDER}/{world}.mapfit.*.csv"))[:1]:
            lines += [f"- {label}: {c}" for c in trace(file)[1] if c.startswith("inside")]
    return "\n".join(lines)


def growth():
    rows = list(csv.DictReader(open(f"{FOLDER}/growth.csv")))
    n = [float(r["control_points"]) for r in rows]
    seconds, memory = [float(r["seconds"]) for r in rows], [float(r["peak_kb"]) / 1024 for r in rows]
    slope = lambda y: statistics.linear_regression([math.log(v) for v in n], [math.log(v) for v in y]).slope
    figure, axis = plt.subplots(figsize=(6, 4))
    axis.loglog(n, seconds, "o-", label=f"seconds, exponent {slope(seconds):.2f}")
    axis.loglog(n, memory, "s-", label=f"MiB, exponent {slope(memory):.2f}")
    axis.set(xlabel="control points", title="A calibrated fit with both covariances")
    axis.legend()
    figure.tight_layout()
    figure.savefig(f"{FOLDER}/growth.svg", metadata={"Date": None})
    lines = ["| control points | returns | fit | with covariance | peak memory | factorisations | converged |", "| --- | --- | --- | --- | --- | --- | --- |"]
    for r, mib in zip(rows, memory):
        lines.append(f"| {r['control_points']} | {r['returns']} | {float(r['fit_seconds']):.1f} s | {float(r['seconds']):.1f} s | {mib:.0f} MiB | {r['factorisations']} | {r['converged']} |")
    return "\n".join(lines), slope(seconds), slope(memory)


def main():
    table, time, memory = growth()
    page = open(os.path.join(FOLDER, "page.md")).read()
    filled = page.format(race=race(), marginals=marginals(), truth=truth(), growth=table, time=time, memory=memory)
    with open(os.path.join(FOLDER, "..", "performance.md"), "w") as out:
        out.write(filled)


sys.exit(main())
