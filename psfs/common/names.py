"""Names that files give to cameras, bodies, bones and joints, and text that is printed."""

from __future__ import annotations

import re
import unicodedata

from cl import InputError

#: Characters of a name, at most: file names have room for 255 bytes, and ours add to the name.
LONGEST_NAME = 100
_SEPARATORS = "/\\"


def check_name(name: object, what: str) -> str:
    """Return `name` if it can be a file's name and be printed; `what` says in errors whose it is.

    Raises InputError for anything but text, empty names, those with separators of paths, control
    characters or outer white space, `.`, `..`, and names that are too long.
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


def printable(text: str) -> str:
    """Return `text` as one line: what cannot be printed is escaped, as in \\x1b or \\udcff."""
    line = re.sub(r"\s*[\r\n]+\s*", " ", text)
    return "".join(c if c.isprintable() else _escaped(c) for c in line)


def _escaped(character: str) -> str:
    if unicodedata.category(character) == "Zs" or character == "\t":
        return " "
    return character.encode("unicode_escape").decode("ascii")
