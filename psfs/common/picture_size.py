"""Limits of the size of pictures."""

from __future__ import annotations

from cl import InputError

#: Pixels along a side, and in all.
LONGEST_SIDE, MOST_PIXELS = 32_768, 2**28


def check_picture_size(size: tuple[int, int], what: str) -> None:
    """Raise InputError unless a picture may be of `size` = (width, height) px."""
    width, height = size
    if min(size) < 1 or max(size) > LONGEST_SIDE or width * height > MOST_PIXELS:
        raise InputError(
            f"{what} {width} x {height} px; expected 1 to {LONGEST_SIDE} along each side and at "
            f"most {MOST_PIXELS:,} in all"
        )


def check_stack(n_cameras: int, size: tuple[int, int]) -> None:
    """Raise InputError if places in the stacked BGR pictures of all cameras, each `size` = (width,
    height) px, exceed 32 bits."""
    width, height = size
    most = (2**31 - 1) // (3 * width * height)
    if n_cameras > most:
        raise InputError(
            f"{n_cameras} cameras with pictures of {width} x {height} px; expected at most {most} "
            "of this size"
        )
