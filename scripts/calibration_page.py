"""docs/calibration.md and its plots from the study's table, and the grid of weights (weights.csv) beside it.

    calibration_page.py STUDY [FRESH]

Lines of FRESH replace those of STUDY with the same world, noise, resolution and beams.
"""

import csv
import os
import sys

import matplotlib

matplotlib.use("svg")
matplotlib.rcParams["svg.hashsalt"] = "mapfit"
import matplotlib.pyplot as plt

KEY = ("world", "noise", "resolution", "beams")
BARS = [
    ("coverage_plain", 0.93, 0.97, "wall farther than h from a corner, 93 to 97 %"),
    ("coverage_corners", 0.92, 1.0, "wall with its corners, at least 92 %"),
    ("ratio", 0.93, 1.07, "predicted over empirical sigma, 0.93 to 1.07"),
    ("ratio_median", 0.93, 1.07, "the same by medians"),
    ("coverage_inside", 0.92, 1.0, "inside, farther than h from the cut locus, at least 92 %"),
    ("pose_coverage", 0.93, 0.97, "refined poses, 93 to 97 %"),
]
WORLDS = ["L", "U", "T", "pillars", "house"]
NOISE = {
    "as1": "as experiment 1",
    "half": "half",
    "five": "five times",
    "poses5": "poses five times",
    "ranges5": "ranges five times",
}
SHOWN = [
    ("coverage_plain", "wall"),
    ("coverage_corners", "with corners"),
    ("coverage_inside", "inside"),
    ("ratio", "predicted / empirical"),
    ("ratio_median", "the same by medians"),
    ("boundary_rms", "wall rms, m"),
    ("inside_rmse", "inside rmse, m"),
    ("pose_position", "position"),
    ("pose_heading", "heading"),
    ("pose_coverage", "pose coverage"),
    ("converged", "converged"),
    ("factorisations", "factorisations"),
]


def read(file):
    return {tuple(row[k] for k in KEY): row for row in csv.DictReader(open(file))} if os.path.exists(file) else {}


def shown(row, name):
    return f"{row[name]} ± {row[name + '_se']}" if name + "_se" in row else row[name]


def table(rows):
    head = "| world | noise | h | scans x beams | " + " | ".join(label for _, label in SHOWN) + " |"
    lines = [head, "| --- " * (4 + len(SHOWN)) + "|"]
    for row in rows:
        cells = [row["world"], NOISE[row["noise"]], row["resolution"], row["beams"]] + [shown(row, name) for name, _ in SHOWN]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def plot(rows, file):
    labels = [f"{r['world']} {NOISE[r['noise']]}, h {r['resolution']}, {r['beams']}" for r in rows]
    place = range(len(rows))
    figure, axes = plt.subplots(1, 2, figsize=(11, 0.32 * len(rows) + 1.4), sharey=True)
    column = lambda name: [float(r[name]) for r in rows]
    for name, marker, label in [("coverage_corners", "x", "with corners"), ("coverage_inside", ".", "inside")]:
        axes[0].plot(column(name), place, marker, label=label)
    axes[0].errorbar(column("coverage_plain"), place, xerr=column("coverage_plain_se"), fmt="o", label="wall")
    axes[0].axvspan(0.93, 0.97, color="tab:green", alpha=0.15)
    axes[0].set(xlabel="two-sigma coverage", yticks=list(place), yticklabels=labels)
    axes[0].margins(y=0.01)
    axes[0].legend(fontsize=8, loc="lower left")
    axes[1].errorbar(column("ratio"), place, xerr=column("ratio_se"), fmt="o", label="by mean squares")
    axes[1].plot(column("ratio_median"), place, "x", label="by medians")
    axes[1].axvspan(0.93, 1.07, color="tab:green", alpha=0.15)
    axes[1].set(xlabel="predicted / empirical sigma at the wall")
    axes[1].legend(fontsize=8)
    axes[0].invert_yaxis()
    figure.tight_layout()
    figure.savefig(file, metadata={"Date": None})


def verdicts(rows):
    lines = []
    for name, least, most, label in BARS:
        beyond = [(max(least - float(row[name]), float(row[name]) - most), 2 * float(row[name + "_se"])) for row in rows]
        held = sum(by <= 0 for by, _ in beyond)
        near = sum(0 < by <= error for by, error in beyond)
        lines.append(f"- {label}: {held} of {len(rows)} cases, {near} more within two standard errors")
    return "\n".join(lines)


def against_grid(file):
    lines = ["| world | automatic, inside | best of the grid | over it | its weights (rho_e, scale, smoothing) |"]
    lines.append("| --- | --- | --- | --- | --- |")
    rows = list(csv.DictReader(open(file)))
    millimetres = lambda row: f"{1e3 * float(row['inside_rmse']):.1f}, walls {1e3 * float(row['boundary_rms']):.1f}"
    for world in WORLDS:
        own = [row for row in rows if row["world"] == world]
        automatic = next(row for row in own if row["weights"] == "automatic")
        best = min((row for row in own if row["weights"] == "grid"), key=lambda row: float(row["inside_rmse"]))
        over = float(automatic["inside_rmse"]) / float(best["inside_rmse"]) - 1
        weights = ", ".join(best[name] for name in ("eikonal_weight", "eikonal_scale", "smoothing"))
        lines.append(f"| {world} | {millimetres(automatic)} | {millimetres(best)} | {100 * over:+.0f} % | {weights} |")
    return "\n".join(lines)


def main():
    study, folder = sys.argv[1], os.path.dirname(sys.argv[1])
    known = read(study)
    for fresh in sys.argv[2:]:
        known |= read(fresh)
    order = lambda row: (WORLDS.index(row["world"]), list(NOISE).index(row["noise"]), row["resolution"], row["beams"])
    rows = sorted(known.values(), key=order)
    with open(study, "w", newline="") as out:
        writer = csv.DictWriter(out, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    plot(rows, os.path.join(folder, "coverage.svg"))
    page = open(os.path.join(folder, "page.md")).read()
    with open(folder + ".md", "w") as out:
        grid = against_grid(os.path.join(folder, "weights.csv"))
        filled = {"cases": str(len(rows)), "table": table(rows), "verdicts": verdicts(rows), "weights": grid}
        for name, text in filled.items():
            page = page.replace("{" + name + "}", text)
        out.write(page)


main()
