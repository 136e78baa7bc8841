"""The contents of a keypoint file, before cameras, frames and persons are selected."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cl import InputError
from psfs.cameras.names import join_names
from psfs.common.ranges import LARGEST


@dataclass(frozen=True, eq=False)
class RawKeypoints:
    """Keypoints as they were read from `path`.

    names: (K,). views: by the camera's name in the file, (F, N, K, 3) x, y px and confidence of N
    persons, NaN where missing; F and N differ from camera to camera. named: whether these names
    identify the camera, or are only numbers. shares: whether x and y are shares of the picture's
    width and height. notes: remarks on what was guessed or left out. first: the number of the first
    frame in the files' names. sparse: whether frames without anybody are left out, also at the end.
    """

    path: Path
    names: tuple[str, ...]
    views: dict[str, np.ndarray]
    named: bool = True
    shares: bool = False
    notes: tuple[str, ...] = ()
    first: int = 0
    sparse: bool = False

    def __post_init__(self) -> None:
        if len(set(self.names)) < len(self.names):
            raise InputError(
                f"{self.path}: keypoint names must differ; found {join_names(self.names)}"
            )
        for camera, view in self.views.items():
            check_view(f"{self.path}: camera {camera}", view)


def check_view(where: str, view: np.ndarray) -> None:
    """Raise InputError unless x, y, confidence (..., 3) are plausible keypoints."""
    known = view[np.isfinite(view).all(-1)]
    if np.isinf(view).any():
        raise InputError(f"{where}: holds an infinite number; expected pixels, or NaN for missing")
    farthest = np.abs(known[:, :2]).max(initial=0)
    if farthest > LARGEST:
        raise InputError(f"{where}: a place at {farthest:g} px; expected up to {LARGEST:g}")
    score = known[:, 2]
    if score.size and not 0 <= score.min() <= score.max() <= LARGEST_SCORE:
        raise InputError(
            f"{where}: confidences go from {score.min():g} to {score.max():g}; expected 0 to 1"
        )


#: Networks' scores may slightly exceed 1 (heat maps, SimCC); much larger numbers are not scores.
LARGEST_SCORE = 3.0
