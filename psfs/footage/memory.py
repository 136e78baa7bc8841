"""Results on the footage that this process opened last.

Reconstructing, checking and tracking one take begin with the same background and diagnosis. What
one of them computed, the next one gets without computing it again, although each opens the take by
itself. Results are forgotten when another folder is asked about, or when a file has changed. A
process hands them to a command that it starts by `store`.
"""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

R = TypeVar("R")

#: Variable of the environment that names the file of another process's results.
STORED = "PSFS_RECALLED"
#: The folder, and the results with their keys.
_KNOWN: dict[Path, list[tuple[object, Any]]] = {}


def recall(
    folder: Path, key: object, compute: Callable[[], R], keeps: Callable[[R], bool] = lambda _: True
) -> R:
    """Return the result of `compute` on the footage in `folder`, the one kept for an equal `key`
    if there is one.

    key: all that the result depends on. keeps: whether a result is kept.
    """
    if stored := os.environ.pop(STORED, None):
        _KNOWN.update(pickle.loads(Path(stored).read_bytes()))
    if folder not in _KNOWN:
        _KNOWN.clear()
    results = _KNOWN.setdefault(folder, [])
    for known, result in list(results):
        if known == key:
            return cast(R, result)
    result = compute()
    if keeps(result):
        results.append((key, result))
    return result


def store(file: Path) -> dict[str, str]:
    """Write the results to a file; return the environment in which a command of this user finds
    them."""
    file.write_bytes(pickle.dumps(_KNOWN))
    return {STORED: str(file)}
