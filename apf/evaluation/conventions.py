"""Detection of the axes of the truth, and of wrong axes or a wrong unit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import permutations, product

import numpy as np

from apf.evaluation.evaluate import evaluate
from apf.formats.trc import CONVENTIONS, JointSeries
from apf.tracking.track import Track

#: Mean error, m, that no track of the same take has; greatest mean error, m, with the right axes,
#: and its greatest share of the error with the stated ones.
_ABSURD, _FITS, _SHARE = 0.4, 0.25, 0.4
#: Factors between the units in common use: mm, cm, dm and m.
_SCALES = (1.0, 1e-3, 1e-2, 1e-1, 1e1, 1e2, 1e3)


def choose_convention(track: Track, truth: JointSeries, stated: str) -> tuple[str, JointSeries]:
    """Return the named convention with which a truth is near the track, and the truth read so.

    truth: read by the `stated` convention, which is returned with it if the truth is not absurdly
    far from the track, or if it is near with no other named one.
    """
    error = evaluate(track, truth).mean_error
    if error < _ABSURD:
        return stated, truth
    read = truth.joints @ CONVENTIONS[stated]  # in the axes of the file
    for name, matrix in CONVENTIONS.items():
        other = replace(truth, joints=read @ matrix.T)
        if evaluate(track, other).mean_error < min(_FITS, _SHARE * error):
            return name, other
    return stated, truth


def axes_that_fit(
    pairs: Sequence[tuple[Track, JointSeries]], error: float, convention: str
) -> str | None:
    """Return a message if the truth, read after `convention`, is absurdly far from the track; else
    None.

    pairs: tracks with the truth that each may have. error: mean distance, m, of track and truth.
    The message names the axes and the unit with which one pair is near, or says that there are
    none.
    """
    if error < _ABSURD:
        return None
    best: tuple[float, str] = (np.inf, "")
    for track, truth in pairs:
        found, words = _find_axes(track, truth, convention)
        if found < best[0]:
            best = found, words
        if best[0] < _FITS:
            break
    if best[0] > min(_FITS, _SHARE * error):
        return (
            f"the truth lies {error:.2f} m from the track, and no other axes or unit bring it "
            "near: is it of this take, and of the same calibration?"
        )
    return (
        f"the truth lies {error:.2f} m from the track with --convention {convention}, but "
        f"{best[0]:.3f} m with {best[1]}"
    )


def _find_axes(track: Track, truth: JointSeries, convention: str) -> tuple[float, str]:
    """Return the least mean distance, m, of a track from the truth in other axes and units, and
    these in words."""
    read = truth.joints @ CONVENTIONS[convention]  # in the axes of the file
    best: tuple[float, str] = (np.inf, "")
    for words, matrix in _candidates():
        for scale in _SCALES:
            other = replace(truth, joints=scale * read @ matrix.T)
            found = evaluate(track, other).mean_error
            if found < 0.95 * best[0]:  # prefer the first of several that are about equal
                best = found, words + ("" if scale == 1 else f" and coordinates times {scale:g}")
        if best[0] < _FITS:
            break
    return best


def _candidates() -> Iterator[tuple[str, np.ndarray]]:
    """Yield the axes that a file may have, likely ones first: their description, and the matrix
    that rotates them to the world's."""
    for name, matrix in CONVENTIONS.items():
        yield f"--convention {name}", matrix
    mirrored: list[tuple[str, np.ndarray]] = []
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        matrix = np.eye(3)[list(order)] * np.array(signs)[:, None]
        axes = [
            f"{'-' if sign < 0 else ''}{'XYZ'[k]}" for k, sign in zip(order, signs, strict=True)
        ]
        words = f"world axes (x, y, z) = ({', '.join(axes)}) of the file"
        if np.linalg.det(matrix) > 0:
            yield f"{words}, which has to be turned so", matrix
        else:
            mirrored.append((f"{words}, which is mirrored", matrix))
    yield from mirrored
