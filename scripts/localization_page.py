"""localization.md and its plot, from cases.csv, all in target/localization, which `scripts/localization` writes."""

import csv

import matplotlib

matplotlib.use("svg")
matplotlib.rcParams["svg.hashsalt"] = "mapfit"
import matplotlib.pyplot as plt

SHOWN = [
    ("method", "method"),
    ("nowhere", "nowhere"),
    ("failed", "failed"),
    ("median_mm", "median, mm"),
    ("p95_mm", "95 %, mm"),
    ("covered", "in the 95 % ellipsoid"),
    ("ms", "ms a scan"),
]
NAMES = {"grid": "Gauss-Newton on a 5 cm grid", "amcl": "amcl (PyPI)"}
TOP = """# Localisation, beside others

Every fifth scan of a log is held out and located on the map of the others, with its pose in the log as the truth, from a start that is
off by a known amount. All methods have the same scans of the map, the same starts and the same prior:

- **mapfit**: `POST /v1/maps/{id}/localize` on a vector map; its poses refined (the default), or taken as the log has them (`"poses": "fixed"`).
- **Gauss-Newton on a grid**: the distance transform of a 5 cm grid of the map's returns, the same robust loss and stages
  (`benches/localization/peers.py`; numpy).
- **amcl**: the particle filter of PyPI's `amcl`, shown each scan eight times.

`scripts/localization` renews this page. A failure is 0.5 m or 10 degrees.

![Errors by method](errors.svg)

"""
END = """
What to make of it: the log's poses are not the truth, only near it. A map of refined poses moves away from them by what its own
evidence says, and its scans are then measured against poses that it does not believe; a map of fixed poses agrees with them. So the refined map's
errors are the log's as much as its own, as are most truths outside the ellipsoids, of every method. Where the truth is known (simulated buildings,
`tests/localization.rs`), truths lie in mapfit's 95 % ellipsoid in 92 to 97 %.
"""


def drawn(rows):
    cases = list(dict.fromkeys(row["case"] for row in rows))
    methods = list(dict.fromkeys(row["method"] for row in rows))
    figure, axes = plt.subplots(figsize=(9, 1.0 + 0.9 * len(cases)), layout="constrained")
    height = 0.8 / len(methods)
    for k, method in enumerate(methods):
        own = {row["case"]: row for row in rows if row["method"] == method}
        places = [c + k * height for c, case in enumerate(cases) if case in own]
        shown = [own[case] for case in cases if case in own]
        bars = axes.barh(places, [float(row["p95_mm"]) for row in shown], height, color=f"C{k}", alpha=0.35)
        axes.barh(places, [float(row["median_mm"]) for row in shown], height, color=f"C{k}", label=NAMES.get(method, method))
        axes.bar_label(bars, [f"{row['median_mm']} / {row['p95_mm']}" for row in shown], fontsize=8, padding=3)
    axes.set_yticks([c + 0.4 - height / 2 for c in range(len(cases))], cases, fontsize=9)
    axes.invert_yaxis()
    axes.margins(x=0.12)
    axes.set_xlabel("error of the position, mm: median (full), 95 % (pale)")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9)
    figure.savefig("target/localization/errors.svg", metadata={"Date": None})


def main():
    rows = list(csv.DictReader(open("target/localization/cases.csv")))
    drawn(rows)
    with open("target/localization/localization.md", "w") as page:
        page.write(TOP)
        for case in dict.fromkeys(row["case"] for row in rows):
            page.write(f"\n**{case}**\n\n| " + " | ".join(label for _, label in SHOWN) + " |\n" + "| --- " * len(SHOWN) + "|\n")
            for row in (row for row in rows if row["case"] == case):
                cells = [NAMES.get(row[name], row[name]) for name, _ in SHOWN]
                page.write("| " + " | ".join(cells) + " |\n")
        page.write(END)


main()
