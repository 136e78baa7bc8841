"""Read projection matrices (3x4) from text and MATLAB files.

A camera is a line of 12 numbers by rows, with or without a name before them, or three lines of 4
numbers. The numbers are read by columns if a line says `# layout: columns`, if there are four lines
of 3 numbers, or if only columns give a possible camera. MATLAB's `.mat` (up to version 7.2) hold
matrices as a cell array, struct array or stack, or K, R and t alike.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from cl import InputError, UserError
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
from psfs.cameras.camera import MOST_CAMERAS
from psfs.cameras.names import join_names
from psfs.cameras.rig_geometry import intersect_axes
from psfs.cameras.units import Unit
from psfs.common.reading import open_input


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


_K, _R, _T = ("K", "KK", "intrinsic"), ("R", "Rc", "rotation"), ("t", "T", "Tc", "translation")


def read_matlab(path: Path, unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read the cameras, without distortion. Metres unless `unit` says otherwise.

    The cells of a variable `names` name them; without it they are cam01, cam02, ... in order.
    """
    with name_file_in_errors(path):
        variables = read_variables(path)
        cells = np.asarray(variables.get("names", [])).ravel()
        names = [str(np.asarray(cell).ravel()[0]) for cell in cells]
        parts = [
            _find_stack(variables, keys, (3, width)) for keys, width in ((_K, 3), (_R, 3), (_T, 1))
        ]
        known = [part for part in parts if part is not None]
        if len(known) == len(parts):
            whole = np.concatenate(known, axis=2)
        else:
            whole = _find_projections(variables)
        names = names or [f"cam{index:02d}" for index in range(1, len(whole) + 1)]
        if len(names) != len(whole):
            raise InputError(f"{len(names)} names for {len(whole)} cameras")
        records = [(name, _split(name, one)) for name, one in zip(names, whole, strict=True)]
        rig = build(PLAIN, records, unit, sizes)
        return mirror_if_facing_away(rig) if whole.shape[2] == 4 else rig


def _split(name: str, values: np.ndarray) -> dict[str, Any]:
    if values.shape[1] == 4:
        return decompose_projection(f"camera {name}", values)
    K = values[:, :3] / values[2, 2]
    return {"K": K, "distortion": [], "R": values[:, 3:6], "t": values[:, 6]}


def read_variables(path: Path) -> dict[str, object]:
    """Return the variables of a MATLAB file by name. Raises InputError."""
    try:
        with open_input(path, "a MATLAB .mat file") as file:
            variables = scipy.io.loadmat(file, struct_as_record=True)
    except NotImplementedError:
        raise InputError("a MATLAB 7.3 file; expected one saved with `save -v7`") from None
    except UserError:
        raise
    except Exception:  # scipy raises anything for bytes that are not a MATLAB file
        raise InputError("cannot be read; expected a MATLAB .mat file") from None
    return {name: value for name, value in variables.items() if not name.startswith("__")}


def _list_matrices(value: object) -> list[np.ndarray]:
    """List the matrices in a variable, which is a cell or struct array, a stack, or one matrix."""
    array = np.asarray(value)
    if array.dtype.names:
        fields = [np.asarray(array[name]).ravel() for name in array.dtype.names]
        return [matrix for field in fields for item in field for matrix in _list_matrices(item)]
    if array.dtype == object:
        return [matrix for item in array.ravel() for matrix in _list_matrices(item)]
    if array.dtype.kind not in "iuf" or array.size > 12 * MOST_CAMERAS:
        return []
    if array.ndim == 3:
        return [array[..., k].astype(float) for k in range(array.shape[2])]
    return [array.astype(float)] if array.ndim == 2 else []


def _find_stack(stored: dict[str, object], keys: tuple[str, ...], shape: tuple[int, int]) -> Any:
    """Return the first variable of `keys` that fits as (N, *shape); None if none fits."""
    for key in keys:
        fitting = [m for m in _list_matrices(stored.get(key, [])) if m.size == shape[0] * shape[1]]
        if fitting:
            return np.stack([matrix.reshape(shape) for matrix in fitting])
    return None


def _find_projections(stored: dict[str, object]) -> np.ndarray:
    fitting = {
        name: [matrix for matrix in _list_matrices(value) if matrix.shape == (3, 4)]
        for name, value in stored.items()
    }
    fitting = {name: matrices for name, matrices in fitting.items() if matrices}
    if not fitting:
        raise InputError(
            f"stored {join_names(stored)}; expected a cell array of 3x4 projection matrices, "
            "or K, R and t"
        )
    most = max(len(matrices) for matrices in fitting.values())
    if most == 1:  # a variable per camera: P1, P2, ...
        return np.stack([matrices[0] for matrices in fitting.values()])
    best = [name for name, matrices in fitting.items() if len(matrices) == most]
    if len(best) > 1:
        raise InputError(f"several sets of matrices ({join_names(best)}); expected one")
    return np.stack(fitting[best[0]])
