"""The number of people that --people states."""

from __future__ import annotations

from apf.tracking.people import MOST_PEOPLE
from cl import InputError


def people_number(text: str) -> int:
    """Return the number of people that --people states. Raises InputError."""
    number = int(text) if text.isdecimal() else 0
    if not 1 <= number <= MOST_PEOPLE:
        raise InputError(f"--people is {text}; expected 1 to {MOST_PEOPLE}, or auto")
    return number
