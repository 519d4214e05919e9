"""Mutations of valid job documents: wrong types and wild numbers here; see `geometry` and `measures` for the others.

A mutated job is made from its seed alone, so a failure is reproduced by its number.
"""

import copy
import json
import math
import random
import sys

from . import rooms
from .geometry import SCANS
from .measures import MEASURES

Document = dict
WILD = [
    0,
    -0.0,
    1,
    -1,
    5e-324,
    1e-300,
    1e-9,
    1e9,
    1e15,
    1e300,
    1.7e308,
    -1e308,
    2**53,
    2**63,
    2**64,
    0.1,
    math.pi,
    1e-6,
    1e3,
    1e6,
]
STRANGE = [None, True, False, "", "x", "1", "NaN", [], {}, [[]], [None], [1, "x"], {"x": 1}, "\u0000", "😀" * 300]


def mutated(seed: int) -> Document:
    """The mutated job of a seed: a small valid one, changed one to three times."""
    draw = random.Random(seed)
    document = _base(draw)
    for _ in range(draw.choice([1, 1, 2, 3])):
        draw.choice(MUTATIONS)(draw, document)
    return document


def _base(draw: random.Random) -> Document:
    document = rooms.job(draw.randrange(50), draw.choice([0.8, 1.0]), draw.choice(["sdf", "vdf"]), beams=31)
    options = draw.choice([{}, {}, {"weighting": "paper"}, {"poses": "fixed"}, {"band": 1}, {"max_iterations": 5}])
    if options:
        document["fit"] = dict(options)
    return document


def _places(value, path=()) -> list[tuple]:
    """Every place in a document; of a long array a few."""
    found = [path] if path else []
    if isinstance(value, dict):
        for key, member in value.items():
            found += _places(member, (*path, key))
    elif isinstance(value, list):
        for k in sorted({0, len(value) // 2, len(value) - 1} & set(range(len(value)))):
            found += _places(value[k], (*path, k))
    return found


def _put(document: Document, path: tuple, value) -> None:
    for step in path[:-1]:
        document = document[step]
    document[path[-1]] = value


def _get(document: Document, path: tuple):
    for step in path:
        document = document[step]
    return document


def wild_number(draw: random.Random, job: Document) -> None:
    places = [p for p in _places(job) if isinstance(_get(job, p), (int, float)) and not isinstance(_get(job, p), bool)]
    if places:
        _put(job, draw.choice(places), draw.choice(WILD))


def scaled_number(draw: random.Random, job: Document) -> None:
    places = [p for p in _places(job) if isinstance(_get(job, p), float)]
    if places:
        path = draw.choice(places)
        _put(job, path, _get(job, path) * draw.choice([-1, 0.1, 10, 100, 1e-3, 1e3, 1 + 1e-15]))


def strange_type(draw: random.Random, job: Document) -> None:
    places = _places(job)
    if places:
        _put(job, draw.choice(places), copy.deepcopy(draw.choice(STRANGE)))


def lost_member(draw: random.Random, job: Document) -> None:
    places = _places(job)
    if not places:
        return
    path = draw.choice(places)
    del _get(job, path[:-1])[path[-1]]


def unknown_member(draw: random.Random, job: Document) -> None:
    inside = draw.choice([p for p in [(), *_places(job)] if isinstance(_get(job, p), dict)])
    _get(job, inside)[draw.choice(["x", "a/b~c", "", "k" * 500, "\u0001"])] = draw.choice(WILD)


ANYWHERE = [wild_number, scaled_number, strange_type, lost_member, unknown_member]
MUTATIONS = [*ANYWHERE, *SCANS, *MEASURES]

if __name__ == "__main__":
    # scripts/nightly$ python -m jobs.mutations 42: the job of a seed, to be sent by hand.
    print(json.dumps(mutated(int(sys.argv[1]))))
