"""Reading and writing of voxel clouds as binary PLY and NPZ, and removal of debris."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy

from cl import InputError
from psfs.common.files import write_atomically
from psfs.common.npz import Values, check_values, get_scalar, read_npz
from psfs.common.regions import split_regions
from psfs.voxels.config import DEBRIS_SHARE
from psfs.voxels.grid import VoxelCloud, VoxelGrid, check_size

#: The columns of the PLY, in this order.
_COLUMNS = {
    "xyz": [("x", "<f4"), ("y", "<f4"), ("z", "<f4")],
    "normal": [("nx", "<f4"), ("ny", "<f4"), ("nz", "<f4")],
    "colour": [("red", "u1"), ("green", "u1"), ("blue", "u1")],
    "probability": [("probability", "<f4")],
}
_PLY_TYPES = {"<f4": "float", "u1": "uchar"}
#: The arrays of an NPZ; colours are optional.
_ARRAYS = {
    "origin": Values((3,), low=-1e6, high=1e6),
    "voxel_size": Values((), low=1e-6, high=1e3),
    "shape": Values((3,), "int", low=1, high=2**20),
    "indices": Values(("N",), "int", low=0),
    "probability": Values(("N",), low=0, high=1),
    "volume": Values(()),
    "colour": Values(("N", 3), "int", low=0, high=255, needed=False),
}


def remove_debris(cloud: VoxelCloud, share: float = DEBRIS_SHARE) -> VoxelCloud:
    """Return the cloud's connected parts with at least `share` of the largest part's surface
    voxels.

    Voxels that share a corner are connected. The volume stays that of all occupied voxels, less the
    surface voxels that are dropped. share: 0 keeps everything, 1 the largest part only.
    """
    if not len(cloud) or share <= 0:
        return cloud
    parts = split_regions(cloud.indices, cloud.grid.shape)
    large = [part for part in parts if len(part) >= share * len(parts[0])]
    kept = np.isin(cloud.indices, np.concatenate(large))
    return replace(
        cloud,
        indices=cloud.indices[kept],
        probability=cloud.probability[kept],
        colour=None if cloud.colour is None else cloud.colour[kept],
        volume=cloud.volume - float((~kept).sum()) * cloud.grid.voxel_size**3,
    )


def coarsen(cloud: VoxelCloud, factor: int) -> VoxelCloud:
    """Return the cloud in voxels `factor` times as long, each with probability and colour of one
    voxel in it."""
    ijk = np.stack(np.unravel_index(cloud.indices, cloud.grid.shape)) // factor
    nx, ny, nz = (-(-n // factor) for n in cloud.grid.shape)
    grid = VoxelGrid(cloud.grid.origin, factor * cloud.grid.voxel_size, (nx, ny, nz))
    flat = np.ravel_multi_index(tuple(ijk), grid.shape)
    indices, first = np.unique(flat.astype(np.int32), return_index=True)
    colour = None if cloud.colour is None else cloud.colour[first]
    return VoxelCloud(grid, indices, cloud.probability[first], colour, cloud.volume)


def write_cloud(cloud: VoxelCloud, stem: Path, normals: bool = False) -> None:
    """Write `stem`.ply, with normals if `normals` is true, and `stem`.npz."""
    write_ply(cloud, stem.with_suffix(".ply"), normals)
    write_npz(cloud, stem.with_suffix(".npz"))


def write_ply(cloud: VoxelCloud, path: Path, normals: bool = False) -> None:
    """Write a binary PLY of the voxels' centres, in metres with Z up, as a comment in the file
    states.

    Its properties are x, y, z; nx, ny, nz (outward) if `normals` is true; red, green, blue if the
    cloud is coloured; probability.
    """
    values = {"xyz": cloud.centres}
    if normals:
        values["normal"] = estimate_normals(cloud)
    if cloud.colour is not None:
        values["colour"] = cloud.colour
    values["probability"] = cloud.probability[:, None]
    columns = [column for name in values for column in _COLUMNS[name]]
    vertices = np.zeros(len(cloud), columns)
    for name, array in values.items():
        for (column, _), row in zip(_COLUMNS[name], array.T, strict=True):
            vertices[column] = row
    properties = [f"property {_PLY_TYPES[kind]} {name}" for name, kind in columns]
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment psfs-apf voxel centres; unit metre; right-handed, Z up",
        f"comment voxel_size {cloud.grid.voxel_size:.9g}",
        f"element vertex {len(cloud)}",
        *properties,
        "end_header",
    ]
    with write_atomically(path) as temporary, temporary.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        file.write(vertices.tobytes())


def write_npz(cloud: VoxelCloud, path: Path) -> None:
    """Write all arrays of a VoxelCloud under the names of its fields and its grid's fields."""
    arrays = {
        "origin": cloud.grid.origin,
        "voxel_size": np.array(cloud.grid.voxel_size),
        "shape": np.array(cloud.grid.shape),
        "indices": cloud.indices,
        "probability": cloud.probability,
        "volume": np.array(cloud.volume),
    }
    if cloud.colour is not None:
        arrays["colour"] = cloud.colour
    with write_atomically(path) as temporary:
        np.savez_compressed(temporary, **arrays)  # type: ignore[arg-type]


def read_cloud(path: Path) -> VoxelCloud:
    """Read a file of `write_npz`. Raises InputError if the file is missing, truncated or of another
    kind."""
    what = "a voxel cloud of `psfs reconstruct`"
    data = read_npz(path, _ARRAYS, what)
    nx, ny, nz = (int(n) for n in data["shape"])
    try:
        grid = VoxelGrid(data["origin"], get_scalar(data["voxel_size"]), (nx, ny, nz))
        check_size(grid)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    indices = data["indices"].astype(np.int32)
    check_values(path, "indices", indices, Values(None, "int", low=0, high=grid.size - 1), {})
    if np.any(np.diff(indices) <= 0):
        raise InputError(f"{path}: indices are not ascending; expected {what}")
    colour = data["colour"].astype(np.uint8) if "colour" in data else None
    probability = data["probability"].astype(np.float32)
    return VoxelCloud(grid, indices, probability, colour, get_scalar(data["volume"]))


#: Standard deviation, voxels, of the Gaussian that smooths the voxels' steps.
_SMOOTHING = 1.5


def estimate_normals(cloud: VoxelCloud) -> np.ndarray:
    """Return (N, 3) outward unit normals of the surface voxels: the negative gradient of the
    smoothed solid that they enclose; zero where the gradient vanishes.

    The inside is known, so the normals need no orientation step.
    """
    if not len(cloud):
        return np.zeros((0, 3))
    ijk = np.stack(np.unravel_index(cloud.indices, cloud.grid.shape))
    i, j, k = ijk - ijk.min(1, keepdims=True) + 2  # in the cloud's box with a border of 2 voxels
    solid = np.zeros((i.max() + 3, j.max() + 3, k.max() + 3), bool)
    solid[i, j, k] = True
    outside, _ = scipy.ndimage.label(~solid)
    solid = outside != outside[0, 0, 0]  # cavities filled
    smooth = scipy.ndimage.gaussian_filter(solid.astype(np.float32), _SMOOTHING, mode="constant")
    slope = np.stack(
        [
            smooth[i + 1, j, k] - smooth[i - 1, j, k],
            smooth[i, j + 1, k] - smooth[i, j - 1, k],
            smooth[i, j, k + 1] - smooth[i, j, k - 1],
        ],
        -1,
    ) / np.float32(2)
    return -slope / np.maximum(np.linalg.norm(slope, axis=-1, keepdims=True), 1e-9)
