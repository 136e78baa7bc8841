"""Fit a person's surface to the outlines of many frames.

It begins as the common surface of the body's cones. Every ray through an outline touches the body;
its distance from the nearest cone, carried back into one pose, says how far the surface lies from
the cones there. A vertex moves along its normal by the mean of the rays around it, as a Gaussian
process with short correlation would: where no ray touches, it stays.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from apf.body.kinematics import posed_cones
from apf.body.model import BodyModel
from apf.body.surface import ALIKE, Surface, choose_spread_pose, normals
from apf.initialisation.personal import NOISE, REACHES, SHARED, Outlines, nearest_outline
from apf.initialisation.shape_model import place_points
from psfs.common.cones import cone_distances, largest_slopes
from psfs.common.least_squares import REACH, robust_weights
from psfs.common.numbers import pick_evenly
from psfs.mesh.config import SMOOTHING
from psfs.mesh.marching_cubes import extract_mesh
from psfs.voxels.grid import VoxelGrid

#: Edge of the voxels, m, that the cones' common surface is extracted from.
_STEP = 0.01
#: Voxels along the edge of a block, all of which are inside or outside if its middle is far so.
_BLOCK = 8
#: Standard deviation, m, of the surface's distance from the cones: clothes and hair.
_SPREAD = 0.03
#: Most frames that inform the surface; steps of its robust mean.
_FRAMES, _STEPS = 64, 4


def fit_surface(
    body: BodyModel, outlines: Sequence[Outlines], poses: np.ndarray, lengths: np.ndarray
) -> Surface:
    """Return the surface of the person who has poses (N, D) in frames with these `outlines`,
    without what they carry. lengths: (E,) m, see `Surface`."""
    some = pick_evenly(len(outlines), _FRAMES)
    several, poses = [outlines[k] for k in some], poses[some]
    pose = choose_spread_pose(body, poses)
    person = body.without_load
    vertices, faces = join_cones(person, pose)
    cones = posed_cones(body, poses)
    frame, cone, coordinates, _, gap = nearest_outline(several, cones)
    # The outline's pixels lie inside the silhouette, half a pixel from its edge.
    here = place_points(cones[frame, cone], coordinates)
    views = np.concatenate([of.views for of in several])
    away = np.linalg.norm(here - several[0].centres[views], axis=1)
    pixel = away * several[0].pixels[views]
    gap = gap + pixel / 2
    touching = np.flatnonzero((np.abs(gap) < REACHES[0]) & (cone < len(person.cones)))
    posed = posed_cones(person, pose[None])[0, cone[touching]]
    points, gap = place_points(posed, coordinates[touching]), gap[touching]
    rays, surface = scipy.spatial.cKDTree(points), scipy.spatial.cKDTree(vertices)
    shares = surface.sparse_distance_matrix(rays, 3 * ALIKE, output_type="coo_matrix")
    shares.data = np.exp(-0.5 * (shares.data / ALIKE) ** 2)
    vertex, moved = surface.query(points)[1], np.zeros(len(vertices))
    precision = np.full(len(vertices), _SPREAD**-2.0)
    for _ in range(_STEPS):
        weights = robust_weights(gap - moved[vertex], REACHES[-1] / REACH) / (SHARED * NOISE**2)
        precision = shares @ weights + _SPREAD**-2.0
        moved = shares @ (weights * gap) / precision
    edge = np.median(pixel) / np.sqrt(12)  # of an edge that may lie anywhere in its pixel
    return Surface(
        pose=pose,
        vertices=(vertices + moved[:, None] * normals(vertices, faces)).astype(np.float32),
        faces=faces.astype(np.int32),
        deviation=(precision**-0.5).astype(np.float32),
        common=np.array(edge),
        lengths=lengths,
        colours=np.zeros((0, 3), np.uint8),
    )


def join_cones(body: BodyModel, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (M, 3) m and faces (T, 3) of the common surface of the cones of `body` in
    `pose` (D,), which is rounded where they meet."""
    cones = posed_cones(body, pose[None])[0]
    reach = np.concatenate([cones[:, [3]], cones[:, [7]]]) + 3 * _STEP
    reach = reach / np.linalg.norm(cones[:, 8:11], axis=1).min()
    ends = np.concatenate([cones[:, 0:3], cones[:, 4:7]])
    low, high = (ends - reach).min(0), (ends + reach).max(0)
    blocks = np.ceil((high - low) / (_STEP * _BLOCK)).astype(int)
    nx, ny, nz = (blocks * _BLOCK).tolist()
    grid = VoxelGrid(low, _STEP, (nx, ny, nz))
    split = np.arange(nx * ny * nz).reshape(np.stack([blocks, 3 * [_BLOCK]], 1).ravel())
    members = split.transpose(0, 2, 4, 1, 3, 5).reshape(np.prod(blocks), -1)
    # The surface does not reach blocks whose middle is far inside a cone or away from all.
    gaps = cone_distances(grid.centres(members[:, [0, -1]]).mean(1), cones)
    far = largest_slopes(cones) * _STEP * (np.sqrt(3) / 2 * _BLOCK + 1)
    near = ((gaps - far).min(1) < 3 * _STEP) & ((gaps + far).min(1) > 0)
    inside = np.empty(nx * ny * nz, np.float32)
    inside[members] = -gaps.min(1, keepdims=True) / _STEP
    for part in np.array_split(members[near].ravel(), max(1, int(near.sum()) // _BLOCK)):
        gaps = cone_distances(grid.centres(part), cones) / _STEP
        least = gaps.min(1, keepdims=True)
        inside[part] = np.log(np.exp(least - gaps).sum(1)) - least[:, 0]
    return extract_mesh(inside.reshape(grid.shape), grid, 0.0, SMOOTHING, debris=0.0)
