"""Settings that must lie in a range, and how a message says so."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any

from cl import InputError


def check_range(
    name: str, value: Any, low: float, high: float = math.inf, ends: bool = False
) -> None:
    """Raise InputError unless `value` is a number with low < value < high; with `ends`, low and
    high are in the range (but never infinity)."""
    number = isinstance(value, Real) and not isinstance(value, bool)
    if number and math.isfinite(value) and (low < value < high or (ends and value in (low, high))):
        return
    if math.isinf(high):
        expected = f"from {low:g} on" if ends else f"above {low:g}"
    else:
        expected = f"from {low:g} to {high:g}" if ends else f"between {low:g} and {high:g}"
    raise InputError(f"{name} is {value!r}; expected a number {expected}")
