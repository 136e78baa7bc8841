"""Results on the footage that this process opened last.

Reconstructing, checking and tracking one take begin with the same background and diagnosis. What
one of them computed, the next one gets without computing it again, although each opens the take by
itself. Results are forgotten when another folder is asked about, or when a file has changed.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

R = TypeVar("R")

#: The folder, and the results with their keys.
_KNOWN: dict[Path, list[tuple[object, Any]]] = {}


def recall(
    folder: Path, key: object, compute: Callable[[], R], keeps: Callable[[R], bool] = lambda _: True
) -> R:
    """Return the result of `compute` on the footage in `folder`, the one kept for an equal `key`
    if there is one.

    key: all that the result depends on. keeps: whether a result is kept.
    """
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
