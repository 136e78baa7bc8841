"""Check numbers, names and the types of arguments, and describe ranges and names in messages."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from numbers import Real
from typing import Any

from cl import InputError

#: The largest number that makes sense without a bound of its own, and how far from an end that
#: is left out a number must stay: beyond, float32 overflows or divides by nothing.
LARGEST, SMALLEST = 1e9, 1e-12
#: Pixels along a side of a picture, and in all.
LONGEST_SIDE, MOST_PIXELS = 32_768, 2**28
#: Greatest distance from the origin, m.
FARTHEST = 10_000.0
#: Most frames of a file that states them: nine hours at 30 frames/s.
MOST_FRAMES = 1_000_000
#: Most ranges of frames, missing numbers or files that a message names.
NAMED = 4


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


def check_number(name: str, value: Any, least: float, most: float = LARGEST) -> None:
    """Raise InputError unless an argument is a number with least <= value <= most; settings have
    ranges of their own, see `psfs.common.config`."""
    number = isinstance(value, Real) and not isinstance(value, bool)
    if not (number and least <= value <= most):  # type: ignore[operator]
        expected = range_text(ge=least, le=most)
        text = escape_unprintable(repr(value))
        raise InputError(f"{name} is {text}; expected a number {expected}")


def range_text(
    gt: float | None = None,
    ge: float | None = None,
    lt: float | None = None,
    le: float | None = None,
) -> str:
    """Return a range in words; `gt` and `lt` are exclusive bounds."""
    if gt is not None and lt is not None:
        return f"between {gt:g} and {lt:g}"
    if ge is not None and ge != -LARGEST and le not in (None, LARGEST):
        return f"from {ge:g} to {le:g}"
    low = "" if ge in (None, -LARGEST) else f"from {ge:g} on"
    low = f"above {gt:g}" if gt is not None else low
    high = f"below {lt:g}" if lt is not None else f"up to {le:g}" if le is not None else ""
    return ", ".join(filter(None, (low, high)))


def spans(frames: Sequence[int], most: int | None = None) -> str:
    """Format frame numbers for a message: `3, 25-32`; most: how many ranges are named."""
    pieces: list[list[int]] = []
    for frame in frames:
        if pieces and frame == pieces[-1][-1] + 1:
            pieces[-1].append(frame)
        else:
            pieces.append([frame])
    named = ", ".join(f"{p[0]}-{p[-1]}" if len(p) > 1 else f"{p[0]}" for p in pieces[:most])
    return (
        named if most is None or len(pieces) <= most else f"{named} and {len(pieces) - most} more"
    )


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


#: Most characters of a name: file names may have 255 bytes, and we add to the name.
LONGEST_NAME = 100
#: Characters of a found value that an error shows.
SHOWN = 60
_SEPARATORS = "/\\"


def check_name(name: object, what: str) -> str:
    """Return `name` if it can be printed and be a file's name; what: its owner, for errors.

    Raises InputError for anything but text, and for names that are empty, too long, `.` or `..`, or
    that contain path separators, control characters or outer white space.
    """
    if not isinstance(name, str):
        raise InputError(f"{what} has the name {name!r}; expected text")
    quoted = repr(name if len(name) <= LONGEST_NAME else name[:LONGEST_NAME] + "...")
    if len(name) > LONGEST_NAME:
        raise InputError(f"{what} {quoted}: a name of {len(name)} characters; "
                         f"expected at most {LONGEST_NAME}")  # fmt: skip
    if not name or name != name.strip() or name in (".", ".."):
        raise InputError(f"{what} has the name {quoted}; expected letters, digits, - and _")
    wrong = [c for c in name if c in _SEPARATORS or not c.isprintable()]
    if wrong:
        raise InputError(
            f"{what} has the name {quoted} with {wrong[0]!r} in it; "
            "expected letters, digits, - and _"
        )
    return name


def escape_unprintable(text: str) -> str:
    r"""Return `text` as one line with unprintable characters escaped, as in \\x1b or \\udcff."""
    line = re.sub(r"\s*[\r\n]+\s*", " ", text)
    return "".join(c if c.isprintable() else _escape(c) for c in line)


def _escape(character: str) -> str:
    if unicodedata.category(character) == "Zs" or character == "\t":
        return " "
    return character.encode("unicode_escape").decode("ascii")
