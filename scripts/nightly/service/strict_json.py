"""JSON as the standard has it: NaN, Infinity and numbers that f64 cannot carry are errors, not numbers."""

import json
import math
from typing import Any


def _refuse(text: str) -> float:
    raise ValueError(f"{text} is not JSON")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]} is not finite")
    return value


def parse(body: bytes | str) -> Any:
    """The value, or `ValueError` where something in it is not finite or not JSON."""
    return json.loads(body, parse_constant=_refuse, parse_float=_finite)
