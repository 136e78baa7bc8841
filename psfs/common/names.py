"""Check names of cameras, bodies, bones and joints, and make text printable."""

from __future__ import annotations

import re
import unicodedata

from cl import InputError

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
    shown = repr(name if len(name) <= LONGEST_NAME else name[:LONGEST_NAME] + "...")
    if len(name) > LONGEST_NAME:
        raise InputError(f"{what} {shown}: a name of {len(name)} characters; "
                         f"expected at most {LONGEST_NAME}")  # fmt: skip
    if not name or name != name.strip() or name in (".", ".."):
        raise InputError(f"{what} has the name {shown}; expected letters, digits, - and _")
    wrong = [c for c in name if c in _SEPARATORS or not c.isprintable()]
    if wrong:
        raise InputError(
            f"{what} has the name {shown} with {wrong[0]!r} in it; "
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
