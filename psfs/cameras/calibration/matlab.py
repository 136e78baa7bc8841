"""Read MATLAB `.mat` files (up to version 7.2).

They hold 3x4 projection matrices as a cell array, struct array or stack, or K, R and t alike.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy

from cl import InputError, UserError
from psfs.cameras.calibration.common import (
    PLAIN,
    Calibration,
    Sizes,
    build,
    name_file_in_errors,
)
from psfs.cameras.calibration.projections import decompose_projection, mirror_if_facing_away
from psfs.cameras.camera import MOST_CAMERAS
from psfs.cameras.names import join_names
from psfs.cameras.units import Unit
from psfs.common.reading import open_input

_K, _R, _T = ("K", "KK", "intrinsic"), ("R", "Rc", "rotation"), ("t", "T", "Tc", "translation")


def read_matlab(path: Path, unit: Unit | None, sizes: Sizes) -> Calibration:
    """Read the cameras, without distortion. Metres unless `unit` says otherwise.

    The cells of a variable `names` name them; without it they are cam01, cam02, ... in order.
    """
    with name_file_in_errors(path):
        variables = read_variables(path)
        names = _read_names(variables)
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


def _read_names(stored: dict[str, object]) -> list[str]:
    cells = np.asarray(stored.get("names", [])).ravel()
    return [str(np.asarray(cell).ravel()[0]) for cell in cells]
