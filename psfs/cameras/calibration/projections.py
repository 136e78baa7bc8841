"""Projection matrices as text: per camera a line of 12 numbers (3x4 row-major), with or without
a name before them, or three lines of 4 numbers.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.linalg import rq

from cl import InputError
from psfs.cameras.calibration.common import Size, Sizes, naming, numbers, read_text, rig_of
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.units import Unit


def read_projections(path: Path, unit: Unit | None = None, sizes: Sizes = None) -> CameraRig:
    """Read the cameras in the order of the file; without names they are cam01, cam02, ... The
    format has no unit: metres unless `unit` says otherwise. No distortion."""
    with naming(path):
        matrices = _matrices(read_text(path))
        names = list(matrices)
        return rig_of(names, sizes, lambda n, size: decomposed(n, matrices[n], size), unit, "m")


def _matrices(text: str) -> dict[str, np.ndarray]:
    lines = [line.replace(",", " ").split() for line in text.splitlines()]
    lines = [words for words in lines if words and not words[0].startswith("#")]
    if lines and all(len(words) == 4 for words in lines) and len(lines) % 3 == 0:
        lines = [[*lines[i], *lines[i + 1], *lines[i + 2]] for i in range(0, len(lines), 3)]
    matrices: dict[str, np.ndarray] = {}
    for index, words in enumerate(lines, 1):
        name = words.pop(0) if len(words) == 13 else f"cam{index:02d}"
        if len(words) != 12:
            raise InputError(f"matrix {index} has {len(words)} numbers; expected 12 (3x4)")
        if name in matrices:
            raise InputError(f"two matrices are called {name}")
        matrices[name] = numbers(words, f"matrix {name}").reshape(3, 4)
    if not matrices:
        raise InputError("no projection matrix; expected lines of 12 numbers")
    return matrices


def decomposed(name: str, P: np.ndarray, size: Size) -> Camera:
    """Return the camera with P ~ K [R t] up to scale, by RQ decomposition of P[:, :3].

    The signs are chosen so that K has a positive diagonal and det R = +1 (P and -P are the same
    projection, so the overall sign is free).
    """
    if not np.isfinite(P).all():
        raise InputError(f"camera {name}: the matrix holds a number that is not finite")
    determinant = np.linalg.det(P[:, :3])
    if abs(determinant) < 1e-12 * np.linalg.norm(P[:, :3]) ** 3:
        raise InputError(f"camera {name}: the matrix is singular; expected a finite camera")
    P = P * np.sign(determinant)
    K, R = rq(P[:, :3])
    signs = np.sign(np.diag(K))
    K, R = K * signs, signs[:, None] * R
    t = np.linalg.solve(K, P[:, 3])
    return Camera(name, K / K[2, 2], np.zeros(5), R, t, size)
