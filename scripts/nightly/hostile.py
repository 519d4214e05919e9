#!/usr/bin/env python3
"""The hostile suite: requests that no honest client sends, jobs mutated by the thousand, and a crowd in 2 GiB.

    scripts/nightly/hostile.py --binary target/release/mapfit --mutations 20000
    scripts/nightly/hostile.py --binary target/release/mapfit --cgroup

500 is always a failure; 503 is one unless it is a refusal for load, with Retry-After, and is counted apart. What
panics, hangs, is not finite, or leaves the service unable to serve others is a failure, too. See
`hostility/verdict.py`. Exit code 1 where anything fails.
"""

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from hostility import crowd, mutants, requests
from hostility.verdict import Verdicts
from service.process import Server


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--binary", default="target/release/mapfit")
    parser.add_argument("--mutations", type=int, default=20_000, help="mutated jobs; 0 for none")
    parser.add_argument("--seed", type=int, default=1, help="of the first mutated job")
    parser.add_argument("--longest", type=float, default=60.0, help="seconds that a mutated job may run")
    parser.add_argument("--only", help="the requests whose names contain this")
    parser.add_argument("--no-requests", action="store_true", help="mutated jobs alone")
    parser.add_argument("--cgroup", action="store_true", help="the crowd in a memory cgroup, and nothing else")
    parser.add_argument("--rows", help="of the crowd, these rows alone, comma-separated")
    parser.add_argument("--seconds", type=float, default=90.0, help="how long the crowd stays")
    parser.add_argument("--server-args", default="", help="more arguments for serve, in one string")
    parser.add_argument("--json", type=Path, help="write a report there")
    return parser.parse_args()


def attack(options: argparse.Namespace, folder: Path) -> Iterator[tuple[str, dict]]:
    """Requests, then mutated jobs, each on a server of its own."""
    if not options.no_requests:
        server = Server(options.binary, folder / "requests", 2, options.server_args.split())
        yield "requests", _under(server, partial(requests.run, server, only=options.only))
    if options.mutations:
        # Small maps, so that thousands end; the large ones are the crowd's. What is fitted in parts is bounded by memory.
        more = ["--max-control-points", "5000", "--memory", "200", *options.server_args.split()]
        server = Server(options.binary, folder / "mutants", 2, more)
        yield "mutants", _under(server, partial(mutants.run, server, options=options))


def _under(server: Server, suite: Callable[..., int]) -> dict:
    """Runs a suite against a server, and looks at what is left of it."""
    verdicts, began = Verdicts(), time.monotonic()
    server.start()
    try:
        server.until_ready()
        attempted = suite(verdicts=verdicts)
        report = {"attempted": attempted, "lives": server.lives, "peak_mib": server.peak_memory() >> 20}
        slowest = 0.0
        for _ in range(20):
            asked = time.monotonic()
            if server.connection(10.0).ask("GET", "/livez").status != 200:
                verdicts.fail("/livez is not 200 at the end")
            slowest = max(slowest, time.monotonic() - asked)
        report["livez_slowest_ms"] = round(1000 * slowest, 1)
        if slowest > 0.5:
            verdicts.fail(f"/livez takes {slowest:.1f} s at the end")
        if not server.terminate(30.0):
            verdicts.fail("the process does not end within 30 s of SIGTERM")
    finally:
        server.kill()
    for panic in server.panics():
        verdicts.fail(f"a panic: {panic[:300]}")
    return report | {
        "seconds": round(time.monotonic() - began, 1),
        "statuses": {str(status): n for status, n in sorted(verdicts.statuses.items(), key=str)},
        "later_503": verdicts.later.total(),
        "later": dict(verdicts.later),
        "bare": verdicts.bare,
        "failures": verdicts.failures,
        **verdicts.figures,
    }


def main() -> int:
    options = arguments()
    folder = Path(tempfile.mkdtemp(prefix="mapfit-hostile-"))
    report, failed = {}, False
    for name, part in crowd.run(options, folder) if options.cgroup else attack(options, folder):
        report[name] = part
        failures = part["failures"]
        failed |= bool(failures)
        figures = ", ".join(
            f"{key} {value}" for key, value in part.items() if key != "later" and not isinstance(value, list)
        )
        print(f"{name}: {len(failures)} failures; {figures}", flush=True)
        for failure in failures:
            print(f"  {failure}", flush=True)
        for what, times in part.get("later", {}).items():
            print(f"  503, {times} times: {what}", flush=True)
        if options.json:
            options.json.write_text(json.dumps(report, indent=2))
    if failed:
        print(f"logs and data: {folder}")
    else:
        shutil.rmtree(folder)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
