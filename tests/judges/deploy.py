"""Lints what lies in `deploy`, and holds its queries against what /metrics serves. Arguments: folder, metrics' text."""

import json
import re
import subprocess
import sys
from pathlib import Path

import promql_parser
import yaml

deploy, metrics = Path(sys.argv[1]), Path(sys.argv[2]).read_text()
programs = Path(sys.executable).parent


def run(*arguments):
    done = subprocess.run([str(a) for a in arguments], capture_output=True, text=True)
    assert done.returncode == 0, f"{arguments[0]}: {done.stdout}{done.stderr}"
    return done.stdout + done.stderr


run(programs / "yamllint", "--strict", "-c", deploy / ".yamllint", deploy)
run(programs / "check-jsonschema", "--builtin-schema", "vendor.compose-spec", deploy / "compose.yaml")
manifests = sorted((deploy / "kubernetes").glob("*.yaml"))
objects = [f for f in manifests if f.name != "kustomization.yaml"]
said = run(programs / "kubernetes-validate", "--strict", *objects)
assert said.count(" passed for resource ") >= 10, said
run(programs / "hadolint", deploy.parent / "Dockerfile")

# The kustomization names every object, but the example of a secret.
kustomization = yaml.safe_load((deploy / "kubernetes/kustomization.yaml").read_text())
named = set(kustomization["resources"]) | {"secret.example.yaml", "kustomization.yaml"}
assert named == {f.name for f in manifests}, named

# Variables that files set are flags that the program has.
cli = subprocess.run([sys.argv[3], "serve", "--help"], capture_output=True, text=True).stdout
cli += subprocess.run([sys.argv[3], "worker", "--help"], capture_output=True, text=True).stdout
texts = [f.read_text() for f in deploy.rglob("*") if f.is_file()]
for variable in {v for text in texts for v in re.findall(r"\bMAPFIT_[A-Z_]+", text)}:
    assert variable in cli, f"{variable} is no variable of mapfit's"
for flag in {f for text in texts for f in re.findall(r"(?:\[|, )(--[a-z-]+)[,\]]", text)}:
    assert flag in cli or flag == "--url", f"{flag} is no flag of mapfit's"

# What is served: names, and the labels of each.
served = {}
for line in metrics.splitlines():
    match = re.match(r"([a-zA-Z_:][a-zA-Z0-9_:]*)(?:\{(.*)\})? ", line)
    if match and not line.startswith("#"):
        labels = set(re.findall(r'([a-zA-Z_]+)="', match[2] or ""))
        served.setdefault(match[1], set()).update(labels)
assert len(served) > 20, served
# What Prometheus adds.
ADDED = {"job", "instance"}


def selectors(node):
    if isinstance(node, promql_parser.VectorSelector):
        yield node
    for name in ("expr", "lhs", "rhs", "vector_selector", "vs", "arg", "param"):
        child = getattr(node, name, None)
        if child is not None and not isinstance(child, str):
            yield from selectors(child)
    for child in getattr(node, "args", None) or []:
        yield from selectors(child)


def check(query, where):
    query = query.replace("$__rate_interval", "5m")
    found = list(selectors(promql_parser.parse(query)))
    # Every name in the text was looked at.
    words = set(re.findall(r"\bmapfit_\w+", query))
    assert words <= {s.name for s in found} and found, f"{where}: {words}, {[s.name for s in found]}"
    for selector in found:
        if selector.name == "up":
            continue
        assert selector.name in served, f"{where}: nothing serves {selector.name}"
        for matcher in selector.matchers.matchers:
            assert matcher.name in served[selector.name] | ADDED, f"{where}: {selector.name} has no {matcher.name}"
    for group in re.findall(r"by \(([^)]*)\)", query):
        own = set().union(*(served.get(s.name, set()) for s in found)) | ADDED
        assert {label.strip() for label in group.split(",")} <= own, f"{where}: by ({group})"


operations = (deploy.parent / "docs/operations.md").read_text()
alerts = yaml.safe_load((deploy / "prometheus/alerts.yaml").read_text())
count = 0
for group in alerts["groups"]:
    for rule in group["rules"]:
        assert set(rule) <= {"alert", "expr", "for", "labels", "annotations"}, rule
        check(rule["expr"], rule["alert"])
        assert rule["labels"]["severity"] in ("page", "ticket")
        anchor = rule["annotations"]["action"]
        assert anchor == f"docs/operations.md#{rule['alert'].lower()}", anchor
        assert f"### {rule['alert']}\n" in operations, f"docs/operations.md does not say what to do about {rule['alert']}"
        count += 1
assert count >= 8

dashboard = json.loads((deploy / "grafana/mapfit.json").read_text())
ids = [panel["id"] for panel in dashboard["panels"]]
assert len(set(ids)) == len(ids) >= 12
cells = set()
for panel in dashboard["panels"]:
    place = panel["gridPos"]
    own = {(x, y) for x in range(place["x"], place["x"] + place["w"]) for y in range(place["y"], place["y"] + place["h"])}
    assert not own & cells and place["x"] + place["w"] <= 24, f"{panel['title']} lies over another"
    cells |= own
    for target in panel["targets"]:
        check(target["expr"], panel["title"])
        assert target["datasource"]["uid"] == "${datasource}"

# Every metric of ours is in the handbook.
families = {re.sub(r"_(bucket|count|sum)$", "", name) for name in served if name.startswith("mapfit_")}
for family in families:
    assert f"`{family}" in operations, f"docs/operations.md does not tell of {family}"
print(f"{count} alerts, {len(ids)} panels, {len(families)} metrics")
