"""docs/calibration.md and its plots from the study's table.

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


def table(rows):
    head = "| world | noise | h | scans x beams | " + " | ".join(label for _, label in SHOWN) + " |"
    lines = [head, "| --- " * (4 + len(SHOWN)) + "|"]
    for row in rows:
        cells = [row["world"], NOISE[row["noise"]], row["resolution"], row["beams"]] + [row[name] for name, _ in SHOWN]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def plot(rows, file):
    labels = [f"{r['world']} {NOISE[r['noise']]}, h {r['resolution']}, {r['beams']}" for r in rows]
    place = range(len(rows))
    figure, axes = plt.subplots(1, 2, figsize=(11, 0.32 * len(rows) + 1.4), sharey=True)
    for name, marker, label in [("coverage_plain", "o", "wall"), ("coverage_corners", "x", "with corners"), ("coverage_inside", ".", "inside")]:
        axes[0].plot([float(r[name]) for r in rows], place, marker, label=label)
    axes[0].axvspan(0.93, 0.97, color="tab:green", alpha=0.15)
    axes[0].set(xlabel="two-sigma coverage", yticks=list(place), yticklabels=labels)
    axes[0].legend(fontsize=8, loc="lower left")
    axes[1].plot([float(r["ratio"]) for r in rows], place, "o")
    axes[1].axvspan(0.93, 1.07, color="tab:green", alpha=0.15)
    axes[1].set(xlabel="predicted / empirical sigma at the wall")
    axes[0].invert_yaxis()
    figure.tight_layout()
    figure.savefig(file, metadata={"Date": None})


def verdicts(rows):
    count = lambda held: f"{sum(held)} of {len(rows)}"
    number = lambda row, name: float(row[name])
    return "\n".join(
        [
            f"- wall farther than h from a corner, 93 to 97 %: {count([0.93 <= number(r, 'coverage_plain') <= 0.97 for r in rows])} cases",
            f"- wall with its corners, at least 92 %: {count([number(r, 'coverage_corners') >= 0.92 for r in rows])}",
            f"- predicted over empirical sigma, 0.93 to 1.07: {count([0.93 <= number(r, 'ratio') <= 1.07 for r in rows])}",
            f"- inside, farther than h from the cut locus, at least 92 %: {count([number(r, 'coverage_inside') >= 0.92 for r in rows])}",
            f"- refined poses, 93 to 97 %: {count([0.93 <= number(r, 'pose_coverage') <= 0.97 for r in rows])}",
        ]
    )


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
        out.write(page.replace("{cases}", str(len(rows))).replace("{table}", table(rows)).replace("{verdicts}", verdicts(rows)))


main()
