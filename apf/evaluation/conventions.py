"""Which axes and unit a truth has, where those that were stated cannot be right."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations, product

import numpy as np

from apf.evaluation.evaluate import Evaluation, evaluate
from apf.formats.trc import CONVENTIONS, JointSeries
from apf.tracking.track import Track

#: m, mean error that no track of the same take has; and that of one whose axes are right, at most
#: also such a share of the error with the stated ones.
_ABSURD, _FITS, _SHARE = 0.4, 0.25, 0.4
#: Units that files are written in for others: mm, cm, m and dm among each other.
_SCALES = (1.0, 1e-3, 1e-2, 1e-1, 1e1, 1e2, 1e3)


def axes_that_fit(
    track: Track, truth: JointSeries, evaluation: Evaluation, convention: str
) -> str | None:
    """Return what to tell where the truth, read after `convention`, is absurdly far from the track
    but near in other axes or another unit; None where it is not, or where nothing fits."""
    error = evaluation.mean_error
    if error < _ABSURD:
        return None
    read = truth.joints @ CONVENTIONS[convention]  # as the file has them
    best: tuple[float, str] = (np.inf, "")
    for words, matrix in _candidates():
        for scale in _SCALES:
            other = replace(truth, joints=scale * read @ matrix.T)
            found = evaluate(track, other).mean_error
            if found < 0.95 * best[0]:  # the first of those that are alike
                best = found, words + ("" if scale == 1 else f" and coordinates times {scale:g}")
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


def _candidates() -> Iterator[tuple[str, np.ndarray]]:
    """Yield the axes that a file may have, likely ones first: how to name them, and the matrix that
    takes them to the world's."""
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
