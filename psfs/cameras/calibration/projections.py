"""Read projection matrices (3x4) from text.

A camera is a line of 12 numbers by rows, with or without a name before them, or three lines of 4
numbers. The numbers are read by columns if a line says `# layout: columns`, if there are four lines
of 3 numbers, or if only columns give a possible camera.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from cl import InputError
from psfs.cameras.calibration.common import (
    LEFT_HANDED,
    MIRROR,
    PLAIN,
    Calibration,
    Sizes,
    build,
    name_file_in_errors,
    parse_numbers,
    read_text,
)
from psfs.cameras.rig_geometry import intersect_axes
from psfs.cameras.units import Unit


def read_projections(path: Path, unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read the cameras in the order of the file; without names they are cam01, cam02, ...

    The format states no unit: metres unless `unit` says otherwise. No distortion.
    """
    with name_file_in_errors(path):
        matrices, notes = _parse_matrices(read_text(path))
        records = [
            (name, decompose_projection(f"camera {name}", P)) for name, P in matrices.items()
        ]
        rig = build(PLAIN, records, unit, sizes)
        return mirror_if_facing_away(replace(rig, notes=(*rig.notes, *notes)))


def mirror_if_facing_away(rig: Calibration) -> Calibration:
    """Mirror a rig of projection matrices if its cameras look away from where their axes meet.

    Projection matrices of a left-handed world decompose into such cameras.
    """
    target = intersect_axes(rig)
    away = [camera.R[2] @ (target - camera.centre) < 0 for camera in rig]
    if len(rig) < 2 or sum(away) <= 0.7 * len(rig):
        return rig
    cameras = tuple(replace(camera, R=-camera.R @ MIRROR, t=-camera.t) for camera in rig)
    return replace(rig, cameras=cameras, notes=(*rig.notes, LEFT_HANDED))


def _parse_matrices(text: str) -> tuple[dict[str, np.ndarray], list[str]]:
    """Parse the matrices (3, 4) by name; return them with remarks."""
    lines = [line.replace(",", " ").split() for line in text.splitlines()]
    lines = [words for words in lines if words and not words[0].startswith("#")]
    columns = re.search(r"^\s*#\s*layout:\s*columns", text, re.MULTILINE) is not None
    for width, height in ((4, 3), (3, 4)):
        if lines and all(len(words) == width for words in lines) and len(lines) % height == 0:
            blocks = [lines[i : i + height] for i in range(0, len(lines), height)]
            lines = [[word for line in block for word in line] for block in blocks]
            columns = columns or width == 3
            break
    values: dict[str, np.ndarray] = {}
    for index, words in enumerate(lines, 1):
        name = words.pop(0) if len(words) == 13 else f"cam{index:02d}"
        if len(words) != 12:
            raise InputError(f"matrix {index} has {len(words)} numbers; expected 12 (3x4)")
        if name in values:
            raise InputError(f"two matrices are called {name}")
        values[name] = parse_numbers(words, f"matrix {name}")
    if not values:
        raise InputError("no projection matrix; expected lines of 12 numbers")
    by_rows = {name: value.reshape(3, 4) for name, value in values.items()}
    by_columns = {name: value.reshape(4, 3).T for name, value in values.items()}
    if columns:
        return by_columns, []
    if any(map(_is_possible_camera, by_rows.values())) or not all(
        map(_is_possible_camera, by_columns.values())
    ):
        return by_rows, []
    return by_columns, ["projection matrices are taken by columns: by rows they are no cameras"]


def _is_possible_camera(P: np.ndarray) -> bool:
    """Return whether a camera could have this matrix: pixels nearly square, little skew."""
    if not np.isfinite(P).all() or abs(np.linalg.det(P[:, :3])) < 1e-12 * np.abs(P).max() ** 3:
        return False
    K = scipy.linalg.rq(P[:, :3])[0]
    fx, fy = abs(K[0, 0]), abs(K[1, 1])
    return bool(0.3 * fy < fx < 3 * fy and abs(K[0, 1]) < 0.1 * fx)


def decompose_projection(what: str, P: np.ndarray) -> dict[str, Any]:
    """Return K, R and t of P (3, 4) ~ K [R t], known up to scale, by RQ decomposition of P[:, :3],
    as a record without distortion. Raises InputError naming `what`.

    P and -P are the same projection, so the signs are chosen such that K has a positive diagonal
    and det R = +1.
    """
    if not np.isfinite(P).all():
        raise InputError(f"{what}: the matrix holds a number that is not finite")
    determinant = np.linalg.det(P[:, :3])
    if abs(determinant) < 1e-12 * np.linalg.norm(P[:, :3]) ** 3:
        raise InputError(f"{what}: the matrix is singular; expected a finite camera")
    P = P * np.sign(determinant)
    K, R = scipy.linalg.rq(P[:, :3])
    signs = np.sign(np.diag(K))
    K, R = K * signs, signs[:, None] * R
    return {"K": K / K[2, 2], "R": R, "t": np.linalg.solve(K, P[:, 3]), "distortion": []}
