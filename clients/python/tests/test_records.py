"""The types name what the service's OpenAPI document names."""

import json
from typing import Any, NotRequired, get_args, get_origin, get_type_hints
from urllib.request import urlopen

import pytest

from mapfit_client import records
from mapfit_client.evaluation import FIELDS, VECTOR_FIELDS

TYPES = {
    "Job": records.JobRecord,
    "Progress": records.Progress,
    "Map": records.MapRecord,
    "Lattice": records.LatticeRecord,
    "Fit": records.FitRecord,
    "StageSeconds": records.StageSeconds,
    "Weights": records.Weights,
    "ProblemReport": records.Problem,
    "Fault": records.Fault,
    "Pose": records.Pose,
    "FittedPose": records.PosedScan,
}


@pytest.fixture(scope="module")
def schemas(url: str) -> dict[str, Any]:
    """The document's schemas."""
    with urlopen(f"{url}/openapi.json") as document:
        found: dict[str, Any] = json.load(document)["components"]["schemas"]
    return found


@pytest.mark.parametrize("name", TYPES)
def test_members(schemas: dict[str, Any], name: str) -> None:
    """Every member of the document is in the type; what the type requires the document requires."""
    hints = get_type_hints(TYPES[name], include_extras=True)
    required = {member for member, hint in hints.items() if get_origin(hint) is not NotRequired}
    schema = schemas[name]
    assert set(schema["properties"]) <= set(hints), f"records.py lacks members of {name}"
    assert required == set(schema["required"])


@pytest.mark.parametrize(
    ("name", "choices"), [("Kind", records.Kind), ("Distance", records.Distance), ("JobStatus", records.JobStatus)]
)
def test_choices(schemas: dict[str, Any], name: str, choices: object) -> None:
    """Words that are chosen among."""
    assert list(get_args(choices)) == schemas[name]["enum"]


def test_a_problem_of_a_request(schemas: dict[str, Any]) -> None:
    """Has what a failed job's problem has, and more."""
    assert set(schemas["Problem"]["properties"]) == set(get_type_hints(records.Problem))


def test_fields(schemas: dict[str, Any]) -> None:
    """What is evaluated the service knows by the same names."""
    assert set(FIELDS + VECTOR_FIELDS) <= set(schemas["FieldName"]["enum"])
