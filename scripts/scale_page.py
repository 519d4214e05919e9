"""docs/scale.md and its picture from what was measured (costs.json) and simulated (workers.csv).

Arguments: the folder of both, the page, the picture.
"""

import csv
import json
import os
import statistics
import sys
from pathlib import Path

import matplotlib

matplotlib.use("svg")
matplotlib.rcParams["svg.hashsalt"] = "mapfit"
import matplotlib.pyplot as plt

FOLDER, PAGE, PICTURE = Path(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3])
costs = json.loads((FOLDER / "costs.json").read_text())
runs = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(open(FOLDER / "workers.csv"))]
BAR = 60.0
# Every robot waits for its place to change by long polls of a minute, and looks at the job that it sent a few times.
POLLS_AN_HOUR, LOOKS_A_JOB = 60, 4
BEATS_A_SECOND = 2

jobs, requests, submissions = costs["jobs"], costs["requests"], costs["submissions"]
job_seconds = statistics.mean(job["cpu"] for job in jobs)


def needed(robots, rate):
    """The run with the fewest workers that holds the bar."""
    own = [run for run in runs if run["robots"] == robots and run["jobs_an_hour"] == rate and run["p95_s"] <= BAR]
    return min(own, key=lambda run: run["workers"])


def table(head, rows):
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


parts = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(open(FOLDER / "parts.csv"))]


def of_parts():
    """Speed-up by workers, a building a row."""
    workers = sorted({row["workers"] for row in parts if row["workers"] > 1})
    rows = []
    for rooms in dict.fromkeys(row["rooms"] for row in parts):
        own = {row["workers"]: row for row in parts if row["rooms"] == rooms}
        one = own[1]
        rows.append([
            f"{rooms:,.0f}", f"{one['active']:,.0f}", f"{one['branches']:.0f}", f"{one['largest MB'] / 1000:.2g} GB",
            *[f"{own[count]['speedup']:.1f}" for count in workers], f"{one['limit']:.1f}",
        ])
    counts = [f"{count:.0f} workers" for count in workers]
    return table(["rooms", "control points in use", "branches", "factor", *counts, "limit"], rows)


def largest(rooms, workers):
    """Gigabytes of the factor that the worker with the most holds."""
    own = next(row for row in parts if (row["rooms"], row["workers"]) == (rooms, workers))
    return f"{own['largest MB'] / 1000:.1f}"


def of_logs():
    rows = []
    for log in dict.fromkeys(job["name"].rsplit(" ", 1)[0] for job in jobs):
        own = [job for job in jobs if job["name"].startswith(log)]
        cpu = [job["cpu"] for job in own]
        rows.append([
            log, len(own), f"{statistics.mean(cpu):.2f} s", f"{min(cpu):.2f} to {max(cpu):.2f} s",
            f"{statistics.mean(job['control_points'] for job in own):,.0f}", f"{statistics.mean(job['body_bytes'] for job in own) / 1024:.0f} KiB",
        ])
    return table(["log", "jobs", "CPU, mean", "from, to", "control points in use", "body"], rows)


def of_robots():
    submit, look, poll = submissions["PostgreSQL"]["cpu_ms"], requests["GET /v1/jobs/{id}"]["cpu_ms"], requests["GET /v1/places/{name}, unchanged"]["cpu_ms"]
    rows = []
    for robots, rate in dict.fromkeys((run["robots"], run["jobs_an_hour"]) for run in runs):
        run = needed(robots, rate)
        a_second = robots * rate / 3600
        serving = (robots * POLLS_AN_HOUR / 3600 * poll + a_second * (submit + LOOKS_A_JOB * look)) / 1000
        writes = 3 * a_second + BEATS_A_SECOND * a_second * job_seconds
        rows.append([
            f"{robots:,.0f}", f"{rate:.0f}", f"{a_second:.3g}", f"**{run['workers']:.0f}**", f"{run['p95_s']:.1f} s", f"{100 * run['busy']:.0f} %",
            f"{serving:.2g} cores", f"{writes:.3g}",
        ])
    return table(["robots", "jobs an hour each", "jobs a second", "workers (cores)", "95 % wait at most", "busy over a shift", "serving", "database writes a second"], rows)


def draw():
    figure, axes = plt.subplots(figsize=(7, 4))
    for robots, rate in dict.fromkeys((run["robots"], run["jobs_an_hour"]) for run in runs):
        own = sorted((run for run in runs if run["robots"] == robots and run["jobs_an_hour"] == rate), key=lambda run: run["workers"])
        axes.plot([run["workers"] for run in own], [max(run["p95_s"], 0.01) for run in own], "o-", label=f"{robots:,.0f} robots, {rate:.0f} an hour")
    axes.axhline(BAR, color="black", linewidth=0.8, linestyle="--")
    axes.text(axes.get_xlim()[0] + 1, BAR * 1.15, "a minute", fontsize=8)
    axes.set(xscale="log", yscale="log", xlabel="workers", ylabel="95 % of the waits in the busiest hour, s")
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)
    figure.tight_layout()
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(PICTURE, metadata={"Date": None})


machine = costs["machine"]
many = needed(10_000, 1)
sqlite, postgres = submissions["SQLite"], submissions["PostgreSQL"]
speedup = costs["speedup"]
cores = many["workers"]
beats = BEATS_A_SECOND * 10_000 / 3600 * job_seconds
page = f"""# Scale

What jobs and requests cost, what fleets of 1, 100 and 10,000 robots need of it, and what is short first. `scripts/scale` measures, simulates and writes this page anew; costs are CPU seconds
of the process (`/proc/PID/stat`), which hardly depend on what else a machine does; rates and waits do. Measured on {machine['date']}: {machine['cpu']}, {machine['cores']} cores, load {machine['load']:.1f} from others at the start.

## What a job costs

A robot's job here: 60 scans of a real log, one after another, as `mapfit submit LOG --from --to` sends them (a vector map at 0.25 m with refined poses).

{of_logs()}

All of them: {job_seconds:.2f} s in the mean, so a core does {3600 / job_seconds:,.0f} an hour. The process's peak memory was {costs['peak_bytes'] / 2**20:.0f} MiB, answers below included; `POST /v1/jobs?dry_run=true` tells any
job's. A service that nobody asks takes {100 * costs['idle_cpu_share']:.1f} % of a core.

## What a request costs

{table(["request", "CPU", "answered after (median)"], [[name, f"{cost['cpu_ms']:.2f} ms", f"{cost['wall_ms']:.1f} ms"] for name, cost in requests.items()])}

Submissions of such a body, with all that it is validated for, and how many a second eight clients had accepted:

{table(["store", "CPU", "answered after (median)", "a second"], [[name, f"{cost['cpu_ms']:.2f} ms", f"{cost['wall_ms']:.1f} ms", f"{cost['a_second']:.0f}"] for name, cost in submissions.items()])}

A job is three commits (accepted, claimed, ended) and two heartbeats a second while it runs. `cargo test --release --test store_conformance -- --ignored --nocapture` prints what claims and pages cost at
100,000 jobs, and holds them to 10 and 5 ms. A page by several conditions, each of which many jobs meet and few meet together, takes tens of milliseconds: it costs what the rarest condition has.

Twelve equal jobs, one worker process or two:

{table(["store", "one", "two", "share", "load"], [[name, f"{s['one']:.1f} s", f"{s['two']:.1f} s", f"{s['share']:.2f}", f"{s['load']:.1f}"] for name, s in speedup.items()])}

Where the load is above the number of cores, others had the second core, and the share says nothing of mapfit.

## What fleets need

A day of robots, simulated (`cargo bench --bench queue`): fleets of 40 robots in the median, a shift of 16 hours that begins between 4 and 8; at its begin every robot sends a job within ten minutes, then so many
an hour at random; one in fifty is urgent. What a job takes is drawn from those above. Workers: the fewest with which 95 % of the jobs of the busiest hour wait less than a minute, on the worst of five days.
Serving: each robot in a long poll for its place, four looks at each job.

{of_robots()}

![95 % of the waits, by the number of workers](images/{PICTURE.name})

**{cores:.0f} workers hold the 95 % under a minute at 10,000 robots** that send a job an hour. The roll call decides: over the shift they are {100 * many['busy']:.0f} % busy. With fewer the wait grows steeply; with more it is gone. Fleets
whose shifts begin together by the minute need more, those that scatter their first jobs over half an hour fewer.

## What is short first

1. **Workers.** At {job_seconds:.1f} s a job everything else is small beside fitting. `mapfit worker` on more machines; `mapfit_queue_oldest_seconds` says when.
2. **Commits of the database.** 10,000 robots at a job an hour are {3 * 10_000 / 3600:.0f} commits a second and {beats:.0f} heartbeats, a quarter more while shifts begin; SQLite on one machine accepted {sqlite['a_second']:.0f} jobs a second here,
   PostgreSQL {postgres['a_second']:.0f}. SQLite carries them, but is one machine: beyond its cores it is PostgreSQL for the workers' sake.
3. **Servers.** One core serves 10,000 robots' polls; pictures and localisation are what costs: {requests['POST localize, one scan']['cpu_ms']:.0f} ms a scan located, {requests['GET ogm (0.1 m, PNG)']['cpu_ms']:.0f} ms an occupancy grid. Servers hold no state; put as many as needed behind the proxy.
4. **Connections.** A robot that waits holds one: `--connections` (8,192) a server, so two servers at 10,000.
5. **Disk.** {10_000 * 16:,} maps a day of about 1 kB a control point ({statistics.mean(job['control_points'] for job in jobs):,.0f} here) are {10_000 * 16 * statistics.mean(job['control_points'] for job in jobs) * 1e3 / 1e12:.1f} TB: `--keep-maps`.

## Maps larger than one fit

A map with more control points in use than `--max-control-points` is fitted in parts: branches of the elimination tree, each of which is
eliminated, and later inverted, without the rest. Solvers of the same process that wait for work take part, pass by pass, and so do workers of
other processes and machines: an attempt offers its branches, whoever has no job takes one under a lease of its own, gets its entries as an
artifact, and sends back its panels and its Schur complement, or the entries that are wanted of the inverse (`src/sparse/parcel.rs`,
`src/worker/parts/`). One whose worker dies is done again by another. `parts` of the job says how many there are and how far the pass is. The
map is the same to the last bit as an undivided one, whoever helped (`tests/parts.rs`), on processors of one kind: products choose their
instructions by what a processor has.

Two worker processes of one solver each on this machine's two cores, 256 rooms (`tests/parts.rs`, the test that is run by hand): 144 and
154 s where one took 161, 167 and 174 s, **1.1 times faster**. Of one worker's time less than two thirds are branches; each costs a helper
half as much again as the work itself, since panels go both ways as files (130 MB a quarter of 144 rooms' factor), and here both ends of the
way share the two cores. Threads of one process gain 1.6 times.

What this does not do: the factor as a whole stays in the memory of the process that fits. So what bounds a map is `--memory` (about
35 kB a control point in use of a vector map, 5 kB more for every doubling beyond 7,000, which `?dry_run=true` tells), and what two cores
gain is a factor of 1.3 to 1.8 ([performance](performance.md)).

### How many workers would help

The tasks of one factorisation, scheduled on so many workers of one core each, on a network of a gigabit
(`cargo run --release --example parts`): halls of 4 m x 4 m, two scans a room, h = 0.2 m, a vector map with refined poses. The
last building has 50,176 m^2. Tasks, sizes and what needs what are those of the real factor; only who does which is simulated.

{of_parts()}

**Eight workers are what helps; from sixteen on nothing is gained**: then the separators at the top of the dissection are what is
left, one after the other, and the longest chain of them is a fifth to a quarter of all work, however large the building. A
worker that shares the columns of a top separator among its cores, as threads of one process do, would shorten that chain;
smaller branches would not. Sixteen workers hold a tenth of the factor each, so a building of 50,000 m^2, whose factor alone has
21 GB, would take {largest(3136, 16)} GB a worker for it. What crosses the network is a tenth to a third of the factor.

## How far the simulation can be trusted

`tests/queue_model.rs` holds it against Erlang's formula (M/M/1, M/M/4; within 5 %), against the stores' rule, and against the service: a stream of 160 jobs of four tenants, with a burst and urgent ones, goes through a real
`mapfit serve`; the simulation gets when jobs arrived and what they took, and has to wait as long as they did: the mean, the 95 %, and the means of the tenants and of the urgent within 15 %. It did within 2 %, the
urgent within 6 %, on a machine with a load of 20 on its two cores; first come, first served would not.
"""
PAGE.write_text(page)
draw()
