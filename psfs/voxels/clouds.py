"""Voxel clouds on disk, binary PLY and NPZ, and free of debris."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from scipy import sparse

from cl import InputError
from psfs.common.files import read_npz, written_whole
from psfs.voxels.grid import VoxelCloud, VoxelGrid

#: Parts of a cloud with fewer voxels than this share of the largest part's are debris.
DEBRIS_SHARE = 0.05

_POSITION = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
_COLOUR = [("red", "u1"), ("green", "u1"), ("blue", "u1")]
_PLY_TYPES = {"<f4": "float", "u1": "uchar"}
#: What an NPZ holds, and the colours where there are some.
_ARRAYS = ("origin", "voxel_size", "shape", "indices", "probability", "volume")


def without_debris(cloud: VoxelCloud, share: float = DEBRIS_SHARE) -> VoxelCloud:
    """Only the connected parts with at least `share` of the largest part's surface voxels.

    Voxels are connected that share a corner. The volume keeps counting all occupied voxels,
    less the voxels that are dropped. share: 0 keeps everything, 1 the largest part only.
    """
    if not len(cloud) or share <= 0:
        return cloud
    label = connected_parts(cloud)
    sizes = np.bincount(label)
    kept = sizes[label] >= share * sizes.max()
    return replace(
        cloud,
        indices=cloud.indices[kept],
        probability=cloud.probability[kept],
        colour=None if cloud.colour is None else cloud.colour[kept],
        volume=cloud.volume - float((~kept).sum()) * cloud.grid.voxel_size**3,
    )


def connected_parts(cloud: VoxelCloud) -> np.ndarray:
    """(N,) int: number of the connected part that each voxel belongs to. Looks at the voxels of
    the cloud only, not at its grid, which may be a thousand times as large."""
    i, j, k = np.unravel_index(cloud.indices, cloud.grid.shape)
    _, ny, nz = cloud.grid.shape
    # Places in a grid with a border, where no neighbour of a voxel lies in another row.
    place = (i * (ny + 2) + j) * (nz + 2) + k
    around = product((-1, 0, 1), repeat=3)
    steps = [(x * (ny + 2) + y) * (nz + 2) + z for x, y, z in around]
    pairs = []
    for step in (step for step in steps if step > 0):  # each pair once
        found = np.minimum(np.searchsorted(place, place + step), len(place) - 1)
        voxels = np.flatnonzero(place[found] == place + step)
        pairs.append((voxels, found[voxels]))
    rows, columns = np.concatenate(pairs, axis=1)
    links = sparse.coo_array((np.ones(len(rows), bool), (rows, columns)), (len(place),) * 2)
    _, label = sparse.csgraph.connected_components(links, directed=False)
    return np.asarray(label)


def coarsened(cloud: VoxelCloud, factor: int) -> VoxelCloud:
    """The cloud in voxels `factor` times as long; each takes over what one voxel in it says."""
    ijk = np.stack(np.unravel_index(cloud.indices, cloud.grid.shape)) // factor
    nx, ny, nz = (-(-n // factor) for n in cloud.grid.shape)
    grid = VoxelGrid(cloud.grid.origin, factor * cloud.grid.voxel_size, (nx, ny, nz))
    places = np.ravel_multi_index(tuple(ijk), grid.shape)
    indices, first = np.unique(places.astype(np.int32), return_index=True)
    colour = None if cloud.colour is None else cloud.colour[first]
    return VoxelCloud(grid, indices, cloud.probability[first], colour, cloud.volume)


def write_cloud(cloud: VoxelCloud, stem: Path) -> None:
    """Write `stem`.ply and `stem`.npz."""
    write_ply(cloud, stem.with_suffix(".ply"))
    write_npz(cloud, stem.with_suffix(".npz"))


def write_ply(cloud: VoxelCloud, path: Path) -> None:
    """Binary PLY of the voxels' centres: metres, Z up (said in a comment), with the property
    `probability`, and red, green, blue if the cloud is coloured."""
    colours = _COLOUR if cloud.colour is not None else []
    columns = [*_POSITION, *colours, ("probability", "<f4")]
    vertices = np.zeros(len(cloud), columns)
    for axis, values in zip("xyz", cloud.centres.T, strict=True):
        vertices[axis] = values
    if cloud.colour is not None:
        for (name, _), values in zip(_COLOUR, cloud.colour.T, strict=True):
            vertices[name] = values
    vertices["probability"] = cloud.probability
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
    with written_whole(path) as temporary, temporary.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii"))
        file.write(vertices.tobytes())


def write_npz(cloud: VoxelCloud, path: Path) -> None:
    """Everything of a VoxelCloud, under the names of its fields and its grid's."""
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
    with written_whole(path) as temporary:
        np.savez_compressed(temporary, **arrays)  # type: ignore[arg-type]


def read_cloud(path: Path) -> VoxelCloud:
    """Inverse of `write_npz`. Raises InputError if the file is absent, cut short or another's."""
    what = "a voxel cloud of `psfs reconstruct`"
    data = read_npz(path, _ARRAYS, what)
    try:
        nx, ny, nz = (int(n) for n in data["shape"])
        grid = VoxelGrid(data["origin"], float(data["voxel_size"]), (nx, ny, nz))
        volume = float(data["volume"])
    except (TypeError, ValueError) as error:
        raise InputError(f"{path}: not {what} ({error})") from error
    return VoxelCloud(grid, data["indices"], data["probability"], data.get("colour"), volume)
