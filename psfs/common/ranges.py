"""Settings that must lie in a range, arguments of a kind, and how a message says so."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any

from cl import InputError
from psfs.common.names import escape_unprintable

#: The largest setting that makes sense without a bound of its own, and how far from an end that
#: is left out a setting must stay: beyond, float32 overflows or divides by nothing.
LARGEST, SMALLEST = 1e9, 1e-12


def check_kind(
    name: str,
    value: Any,
    kinds: type | tuple[type, ...],
    hint: str = "",
    needed: bool = False,
) -> None:
    """Raise InputError unless an argument of the library is one of these `kinds` or, where it is
    not `needed`, None; hint: how to make one."""
    kinds = kinds if isinstance(kinds, tuple) else (kinds,)
    if isinstance(value, kinds) or (value is None and not needed):
        return
    expected = " or ".join(kind.__name__ for kind in kinds)
    raise InputError(
        f"{name} is {escape_unprintable(repr(value))[:80]}, of type {type(value).__name__}; "
        f"expected {expected}{hint}"
    )


def check_range(
    name: str, value: Any, low: float, high: float = math.inf, ends: bool = False
) -> None:
    """Raise InputError unless `value` is a number with low < value < high; with `ends`, low and
    high are in the range. No number may be above `LARGEST`."""
    top = min(high, LARGEST)
    number = isinstance(value, Real) and not isinstance(value, bool)
    if number and abs(value) <= LARGEST:  # nor NaN
        if ends and low <= value <= top:
            return
        if not ends and low + SMALLEST <= value < top:
            return
    if math.isinf(high):
        expected = f"from {low:g} on" if ends else f"above {low:g}"
        expected += f", up to {LARGEST:g}"
    else:
        expected = f"from {low:g} to {high:g}" if ends else f"between {low:g} and {high:g}"
    raise InputError(f"{name} is {escape_unprintable(repr(value))}; expected a number {expected}")
