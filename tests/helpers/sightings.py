"""Points of bodies as cameras see them."""

import numpy as np

from apf.body.kinematics import bone_matrices
from apf.body.model import BodyModel
from apf.likelihood.observations import PointObservations
from psfs.cameras.camera import CameraRig


def seen_points(
    body: BodyModel,
    pose: np.ndarray,
    rig: CameraRig,
    n_points: int,
    seed: int = 0,
    as_partners: bool = False,
) -> PointObservations:
    """`n_points` on random bones, each in every camera of `rig` that it is before, exactly where
    `pose` (D,) has it, or its partner. Of every three points, two are partners of each other."""
    random = np.random.default_rng(seed)
    bone = random.integers(len(body.bones), size=n_points)
    position = random.normal(0, 0.1, (n_points, 3))
    rotations, origins = bone_matrices(body, pose[None])
    world = origins[0, bone] + np.einsum("pij,pj->pi", rotations[0, bone], position)
    numbers = np.arange(n_points)
    other = np.where(numbers % 3 == 0, numbers + 1, np.where(numbers % 3 == 1, numbers - 1, -1))
    other = np.where(other < n_points, other, -1)
    if as_partners:
        world = world[np.where(other >= 0, other, numbers)]
    point, camera, pixels = [], [], []
    for view, one in enumerate(rig):  # without distortion
        seen = world @ one.R.T + one.t
        before = np.flatnonzero(seen[:, 2] > 0.1)
        pixels.append((seen[before] / seen[before, 2:]) @ one.K[:2].T)
        point.append(before)
        camera.append(np.full(len(before), view))
    which = np.concatenate(point)
    inverse = random.uniform(0.2, 0.5, len(which))
    return PointObservations(
        bone, position, which, other[which], np.concatenate(camera), np.concatenate(pixels), inverse
    )
