"""What is written by hand names what the service's OpenAPI document names; the rest is made from it (`./generate`)."""

import json
from typing import Any, NotRequired, get_args, get_origin, get_type_hints
from urllib.request import urlopen

import pytest

from mapfit_client import records
from mapfit_client.evaluation import FIELDS, VECTOR_FIELDS


@pytest.fixture(scope="module")
def schemas(url: str) -> dict[str, Any]:
    """The schemas of the service that runs."""
    with urlopen(f"{url}/openapi.json") as document:
        found: dict[str, Any] = json.load(document)["components"]["schemas"]
    return found


def test_a_problem_is_a_requests_or_a_jobs(schemas: dict[str, Any]) -> None:
    """It has all members of either, and requires what both have."""
    hints = get_type_hints(records.Problem, include_extras=True)
    required = {member for member, hint in hints.items() if get_origin(hint) is not NotRequired}
    assert set(hints) == set(schemas["Problem"]["properties"])
    assert required == set(schemas["ProblemReport"]["required"])


def test_words_that_are_chosen_among(schemas: dict[str, Any]) -> None:
    """Constants hold the document's."""
    assert list(records.KINDS) == schemas["Kind"]["enum"]
    assert set(schemas["JobStatus"]["enum"]) >= records.ENDED
    assert list(get_args(records.Distance)) == schemas["Distance"]["enum"]


def test_fields(schemas: dict[str, Any]) -> None:
    """What is evaluated the service knows by the same names."""
    assert set(FIELDS + VECTOR_FIELDS) <= set(schemas["FieldName"]["enum"])
