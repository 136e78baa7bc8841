"""Find what a person carries: matter that moves with the trunk and is thicker than an arm.

Without it, arms would have to explain a box that is held, and reach for its corners. It becomes
some more parts of the body, which arms stay out of, and is measured and tracked as the others are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from apf.body.kinematics import bone_matrices, posed_cones
from apf.body.limbs import arm_cones
from apf.body.model import LOAD, BodyModel, Cone
from apf.body.stature import stature
from psfs.common.cones import cone_distances
from psfs.common.regions import keep_large_regions
from psfs.mesh.marching_cubes import fill_cloud, occupied_box
from psfs.voxels.grid import VoxelCloud

#: Edge of the cells, m, and distance, m, from the root up to which matter may move with it.
_CELL, _REACH = 0.04, 0.8
#: Distance, m, from the body up to which matter is the body's: clothes, and hulls of few cameras.
_CLOTHES = 0.05
#: Shares of the frames in which a cell holds matter that moves with the root: within a load, and of
#: what is at least so thick, m, in a load alone. Arms that balance are in one place in half of the
#: frames, and in hulls of few cameras they are thinner.
_LASTING, _SURE, _THICK = 0.5, 0.8, 0.13
#: Radius of the balls that fill a load, as a share of that of the largest one in it: arms beside it
#: are thinner.
_BULK = 0.6


def find_load(body: BodyModel, poses: np.ndarray, clouds: Sequence[VoxelCloud]) -> list[Cone]:
    """Return what the person carries as upright cones on the body's root, one for each quarter that
    has something of it. poses: (M, D) in frames with these surface voxels."""
    side = np.arange(-_REACH, _REACH + _CELL / 2, _CELL)
    cells = np.stack(np.meshgrid(side, side, side, indexing="ij"), -1)
    flat = cells.reshape(-1, 3)
    rotations, origins = bone_matrices(body, poses)
    arms = [cone for cones in arm_cones(body) for cone in cones]
    others = np.setdiff1d(np.arange(len(body.cones)), arms)
    posed, lasting = posed_cones(body, poses)[:, others], np.zeros(len(flat))
    for rotation, origin, cones, cloud in zip(
        rotations[:, 0], origins[:, 0], posed, clouds, strict=True
    ):
        if not len(cloud.indices):
            continue
        box = occupied_box(cloud)
        centres = flat @ rotation.T + origin
        ijk = np.floor((centres - box.origin) / box.voxel_size).astype(int)
        inside = np.flatnonzero(((ijk >= 0) & (ijk < box.shape)).all(1))
        inside = inside[fill_cloud(cloud, box)[tuple(ijk[inside].T)]]
        lasting[inside] += cone_distances(centres[inside], cones).min(1) > _CLOTHES
    share = lasting.reshape(cells.shape[:3]) / max(1, len(clouds))
    # How deep cells lie, in cells; below 0 outside.
    depth, sure = (
        np.asarray(scipy.ndimage.distance_transform_edt(share > least)) - 0.5
        for least in (_LASTING, _SURE)
    )
    if sure.max() * _CELL < _THICK / 2:
        return []
    radius = _BULK * depth.max()
    core = keep_large_regions(depth >= radius, 1.0)
    filled = cells[np.asarray(scipy.ndimage.distance_transform_edt(~core)) <= radius]
    quarter = (filled[:, :2] > np.median(filled[:, :2], axis=0)) @ (1, 2)
    return [_fit_cone(f"{LOAD}_{k + 1}", filled[quarter == k]) for k in np.unique(quarter)]


def add_load(template: BodyModel, load: Sequence[Cone], height: float) -> BodyModel:
    """Return the template with the load of a person of this height, m, scaled to it."""
    size = stature(template) / height
    parts = [
        replace(
            cone, start=size * cone.start, end=size * cone.end,
            radii=(size * cone.radii[0], size * cone.radii[1]),
        )
        for cone in load
    ]  # fmt: skip
    added = range(len(template.cones), len(template.cones) + len(parts))
    pairs = [(arm, part) for cones in arm_cones(template) for arm in cones for part in added]
    return replace(template, cones=(*template.cones, *parts), apart=(*template.apart, *pairs))


def _fit_cone(name: str, cells: np.ndarray) -> Cone:
    """Return an upright cone on the root that fills about as much as `cells` (N, 3) m."""
    middle = cells.mean(0)
    radii = 2 * np.sqrt(cells[:, :2].var(0) + _CELL**2 / 12)
    radius = float(np.sqrt(radii.prod()))
    half = max(_CELL / 2, (len(cells) * _CELL**3 / (np.pi * radius**2) - 4 / 3 * radius) / 2)
    up, (along, across) = half * np.eye(3)[2], (radii / radius).tolist()
    return Cone(name, 0, middle - up, middle + up, (radius, radius), np.eye(3)[0], (along, across))
