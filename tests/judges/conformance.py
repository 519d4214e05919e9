"""The service against its own OpenAPI document, judged by schemathesis: every check, the same requests each time. Arguments: base URL, an API key
of every scope, and how many examples an operation has (12; a night has time for 100).

A client generated from the document must work, so the document must be true: statuses, media types, bodies and headers
are those it names, what it forbids is refused, what it allows is accepted or refused for a reason that no schema can say.
"""

import json
import math
import sys
import tempfile
import urllib.request
from pathlib import Path

import schemathesis
from schemathesis.cli import schemathesis as command
from schemathesis.openapi.checks import UseAfterFree

base, key = sys.argv[1].rstrip("/"), sys.argv[2]
EXAMPLES = int(sys.argv[3]) if len(sys.argv) > 3 else 12


def scan(beams):
    """From the middle of a room of 4 m by 4 m."""
    bearings = [2 * math.pi * k / beams - math.pi for k in range(beams)]
    ranges = [2 / max(abs(math.cos(b)), abs(math.sin(b))) for b in bearings]
    step = 2 * math.pi / beams
    pose = {"x": 0.0, "y": 0.0, "theta": 0.0}
    return {"pose": pose, "angle_min": -math.pi, "angle_increment": step, "range_min": 0.05, "range_max": 30.0, "ranges": ranges}


def job(resolution, beams, priority=0):
    noise = {"sigma_x": 0.01, "sigma_y": 0.01, "sigma_theta": 0.005, "sigma_range": 0.02}
    return {"scans": [scan(beams)], "noise": noise, "map": {"distance": "sdf", "resolution": resolution}, "priority": priority}


def ask(path, body=None, method=None):
    data = body and json.dumps(body).encode()
    headers = {"content-type": "application/json", "authorization": f"Bearer {key}"}
    with urllib.request.urlopen(urllib.request.Request(base + path, data, headers, method=method)) as answer:
        return json.load(answer)


def hooked():
    """A webhook's id."""
    return ask("/v1/webhooks", {"url": "https://hooks.example/", "events": ["job.successful"]})["id"]


def published(name):
    """A place of this name."""
    return ask(f"/v1/places/{name}", {"map_id": map_id}, "PUT")["name"]


def fitted():
    """A small job and its map, by id."""
    ended = ask(f"/v1/jobs/{ask('/v1/jobs', job(0.5, 60, 1000))['id']}?wait=60")
    assert ended["status"] == "successful", ended
    return ended["id"], ended["map_id"]


job_id, map_id = fitted()
real = {"jobs": job_id, "maps": map_id, "webhooks": hooked(), "places": published("hall")}
examples = {"part": "poses", "layer": "distance", "z": 7, "x": 0, "y": 0}
cancelled = set()


@schemathesis.deserializer("application/x-npz", "application/x-mcap", "application/zip", "image/png", "image/tiff")
def binary(context, response):
    """Bytes are a string to a schema; what is in them other judges say."""
    return response.content.decode("latin-1")


@schemathesis.hook
def before_load_schema(context, document):
    """Real ids and bodies as examples: what a fit is asked for cannot be guessed."""
    for path, item in document["paths"].items():
        for operation in item.values():
            for parameter in operation.get("parameters", []):
                if parameter["in"] == "path":
                    parameter["example"] = examples.get(parameter["name"], real.get(path.split("/")[2]))
                if parameter["name"] == "since":
                    parameter["example"] = map_id
    noise = job(0.5, 60)["noise"]
    body = {
        ("/v1/jobs", "post"): job(0.5, 60),
        ("/v1/maps/{id}/query", "post"): {"points": [[0.5, 0.5], [1.5, -1.0]]},
        ("/v1/maps/{id}/localize", "post"): {"scans": [scan(60)], "noise": noise},
        ("/v1/maps/{id}/updates", "post"): {"scans": [scan(30)], "noise": noise},
        ("/v1/joins", "post"): {"maps": [{"id": map_id}], "map": {"resolution": 0.5}},
        ("/v1/places/{name}", "put"): {"map_id": map_id},
        ("/v1/places/{name}/rollback", "post"): {"version": 1},
        ("/v1/webhooks", "post"): {"url": "https://hooks.example/", "events": ["job.failed"]},
    }
    for (path, method), example in body.items():
        document["paths"][path][method]["requestBody"]["content"]["application/json"]["example"] = example


@schemathesis.hook
def before_call(context, case, kwargs):
    """What is deleted is made for it: a map of its own, a job that is still at work; the shared ones stay."""
    # A place's map is elsewhere: that is its answer.
    kwargs["allow_redirects"] = False
    if case.method != "DELETE" or not set(case.path_parameters.values()) & set(real.values()):
        return
    match case.operation.path.split("/")[2]:
        case "jobs":
            case.path_parameters["id"] = ask("/v1/jobs", job(0.03, 720))["id"]
        case "maps":
            case.path_parameters["id"] = fitted()[1]
        case "webhooks":
            case.path_parameters["id"] = hooked()
        case "places":
            case.path_parameters["name"] = published("another")


@schemathesis.hook
def after_call(context, case, response):
    if case.method == "DELETE" and "/jobs/" in case.operation.path and response.status_code == 200 and not case.query:
        cancelled.add(case.path_parameters["id"])


@schemathesis.hook
def filter_failure(context, failure, case, response):
    """By the contract a job that was cancelled is kept, as dismissed: to read it is no use after free."""
    return not (isinstance(failure, UseAfterFree) and case.path_parameters.get("id") in cancelled)


# Everything that the document allows must be accepted, apart from ids that nobody has (404), jobs that have ended (409), and
# what no schema can say (409 or 412: a place is not as a condition says, a job has not ended; 429: there are as many webhooks as
# may be; 422): maps and versions that places have, networks that webhooks may reach, labels' keys, cursors of this service, boxes in order, numbers that fit the map's lattice, what covariance's
# `form` asks of the rest, a map that `since` names, and of a job, an update, a join and of scans to be located that ranges, bounds and poses belong together.
CONFIG = """
continue-on-failure = true
request-timeout = 60
cache.enabled = false
output.sanitization.enabled = false
warnings.fail-on = ["missing_deserializer", "missing_test_data"]
dictionaries.jobs.values = ["{job_id}"]
dictionaries.maps.values = ["{map_id}"]
phases.fuzzing.extra-data-sources.responses = false

[auth.openapi.key]
bearer = "{key}"

[generation]
deterministic = true
database = "none"
max-examples = {examples}

[checks.positive_data_acceptance]
expected-statuses = ["2xx", "304", "404", "409"]

[[operations]]
include-name = ["GET /v1/jobs", "POST /v1/jobs", "POST /v1/joins", "GET /v1/maps"]
checks.positive_data_acceptance.expected-statuses = ["2xx", "304", "404", "409", "422"]

[[operations]]
include-path-regex = "^/v1/(places|webhooks)"
checks.positive_data_acceptance.expected-statuses = ["2xx", "304", "307", "404", "409", "412", "422", "429"]

[[operations]]
include-method = "PATCH"
checks.positive_data_acceptance.expected-statuses = ["2xx", "404", "422"]

[[operations]]
include-path = ["/v1/maps/{{id}}/changes", "/v1/maps/{{id}}/localize", "/v1/maps/{{id}}/updates", "/v1/maps/{{id}}/covariance", "/v1/maps/{{id}}/grid", "/v1/maps/{{id}}/mcap", "/v1/maps/{{id}}/ogm"]
checks.positive_data_acceptance.expected-statuses = ["2xx", "304", "404", "409", "422"]

[[operations]]
include-path-regex = "^/v1/jobs/"
parameters."path.id" = {{ dictionary = "jobs", probability = 0.6 }}

[[operations]]
include-path-regex = "^/v1/maps/"
parameters."path.id" = {{ dictionary = "maps", probability = 0.6 }}
"""

with tempfile.TemporaryDirectory() as folder:
    config = Path(folder, "schemathesis.toml")
    config.write_text(CONFIG.format(job_id=job_id, map_id=map_id, key=key, examples=EXAMPLES))
    command.main(["--no-color", "--config-file", str(config), "run", f"{base}/openapi.json", "--checks", "all"])
