"""Detection of the axes of the truth, and of wrong axes or a wrong unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from apf.evaluation.evaluate import evaluate
from apf.evaluation.joint_names import evaluated_joints
from apf.formats.trc import CONVENTIONS, JointSeries
from apf.tracking.track import Track
from psfs.common.numbers import match_pairs

#: Mean error, m, that no track of the same take has; half of it, none with the right axes.
_ABSURD = 0.4


def choose_convention(track: Track, truth: JointSeries, stated: str) -> tuple[str, JointSeries]:
    """Return the named convention with which a truth is near the track, and the truth read so.

    truth: read by the `stated` convention, which is returned with it if the truth is not absurdly
    far from the track, or if it is near with no other named one.
    """
    error = evaluate(track, truth).mean_error
    read = truth.joints @ CONVENTIONS[stated]  # in the axes of the file
    for name, matrix in CONVENTIONS.items() if error >= _ABSURD else ():
        other = replace(truth, joints=read @ matrix.T)
        if evaluate(track, other).mean_error < _ABSURD / 2:
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
    best, words = min(_estimate_axes(*pair, convention) for pair in pairs)
    if best > _ABSURD / 2:
        return (
            f"the truth lies {error:.2f} m from the track, and no other axes or unit bring it "
            "near: is it of this take, and of the same calibration?"
        )
    return (
        f"the truth lies {error:.2f} m from the track with --convention {convention}, but "
        f"{best:.3f} m with {words}"
    )


def _estimate_axes(track: Track, truth: JointSeries, convention: str) -> tuple[float, str]:
    """Return the mean distance, m, of a track from the truth in the axes and the unit, a power of
    ten of metres, that are nearest to the linear map from one to the other, and these in words."""
    truth = truth.at_rate(track.fps)
    read = truth.joints @ CONVENTIONS[convention]  # in the axes of the file
    _, rows, true_rows = np.intersect1d(track.frames, truth.frames, return_indices=True)
    ours = evaluated_joints(track.joint_names, track.joints[rows])[0].reshape(-1, 3)
    true = evaluated_joints(truth.joint_names, read[true_rows])[0].reshape(-1, 3)
    known = np.isfinite(ours).all(1) & np.isfinite(true).all(1)
    if known.sum() < 3:
        return np.inf, ""
    linear = np.linalg.lstsq(true[known], ours[known], rcond=None)[0].T
    size = np.linalg.norm(linear) / np.sqrt(3)
    scale = 10.0 ** np.rint(np.log10(max(size, np.finfo(float).tiny)))
    matrix = np.zeros((3, 3))
    for row, column in match_pairs(-np.abs(linear), np.inf):
        matrix[row, column] = 1.0 if linear[row, column] > 0 else -1.0
    signs = {-1.0: "-", 0.0: "", 1.0: ""}
    axes = [f"{signs[row.sum()]}{'XYZ'[np.abs(row).argmax()]}" for row in matrix]
    kind = "which has to be turned so" if np.linalg.det(matrix) > 0 else "which is mirrored"
    words = f"world axes (x, y, z) = ({', '.join(axes)}) of the file, {kind}"
    named = [name for name, other in CONVENTIONS.items() if np.array_equal(other, matrix)]
    words = f"--convention {named[0]}" if named else words
    unit = "" if scale == 1 else f" and coordinates times {scale:g}"
    moved = replace(truth, joints=scale * read @ matrix.T)
    return evaluate(track, moved).mean_error, words + unit
