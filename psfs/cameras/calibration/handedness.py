"""Detect left-handed worlds by the determinant of the rotations, and mirror them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np

from cl import InputError

#: Takes a left-handed world to a right-handed one: negates X.
MIRROR = np.diag([-1.0, 1.0, 1.0])
LEFT_HANDED = "the calibration's world is left-handed: its X axis is negated"

#: One entry per rotation of the calibration being read: whether it is left-handed.
_seen: ContextVar[list[bool] | None] = ContextVar("handedness", default=None)


def make_right_handed(R: np.ndarray) -> np.ndarray:
    """Return R (3, 3), orthogonal, in the mirrored world if its determinant is -1."""
    left = bool(np.linalg.det(R) < 0)
    seen = _seen.get()
    if seen is not None:
        seen.append(left)
    return R @ MIRROR if left else R


@contextmanager
def record_handedness() -> Iterator[list[bool]]:
    """Collect for each rotation that is read inside whether it is left-handed."""
    seen: list[bool] = []
    token = _seen.set(seen)
    try:
        yield seen
    finally:
        _seen.reset(token)


def check_same_handedness(seen: list[bool]) -> None:
    """Raise InputError if some rotations are left-handed and others are not."""
    if any(seen) and not all(seen):
        raise InputError(
            f"{sum(seen)} of {len(seen)} rotations have determinant -1, the others 1; expected "
            "all cameras in one world, right-handed or left-handed"
        )
