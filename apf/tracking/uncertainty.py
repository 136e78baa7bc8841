"""Uncertainty of the joints' positions in a track.

The linear system of the refinement says how firmly the voxels constrain every angle; an arm in
front of the trunk is constrained by few voxels. Its inverse and the spread of the particles are
propagated to the joints. They are scaled so that the 95 % ellipsoids hold a known truth in
95 % of the frames, as long as no limb is lost.
Without refinement (the papers' presets) nothing is stated: the particles' spread alone held 23 % of
the true joints where it stated 95 %.
A floor per joint covers systematic errors: the voxels' resolution, and joint centres that differ
between person and model.

Where body and voxels do not fit (loose clothes, poor silhouettes, a person unlike the model), all
deviations grow with the misfit, as those of a least-squares fit do with its residuals (Birge 1932,
Phys. Rev. 40, 207-227).
"""

from __future__ import annotations

import numpy as np
import scipy

from apf.body.angles import joint_angles
from apf.body.jacobian import bone_point_jacobian
from apf.body.kinematics import posed_points
from apf.body.model import BodyModel, sideless

#: Factor of the stated deviations, and least deviation, m, of every coordinate of a joint, by its
#: name without the side, with a middle value for others. Estimated from tracks with known truth,
#: plus a tenth. In cross-validation, leaving out one, the 95 % ellipsoids hold 83 to 98 % of the
#: true joints.
SCALE, OTHER_FLOOR = 2.0, 0.03
FLOORS = {
    "pelvis": 0.011,
    "neck": 0.013,
    "head_top": 0.013,
    "shoulder": 0.024,
    "elbow": 0.025,
    "wrist": 0.023,
    "hip": 0.016,
    "knee": 0.016,
    "ankle": 0.010,
}
#: Misfit of a pose up to which the deviations hold as they are; above it they grow in proportion.
#: Tuned: bodies that fit have 0.11; without a film of the empty room, with a rig that is off or in
#: a skirt the 95 % ellipsoids hold 96 to 99 % (60 to 93 % without it), and 90 % of a person who did
#: not serve to set it.
SOUND_MISFIT = 0.13


def joint_covariance(
    body: BodyModel,
    poses: np.ndarray,
    information: np.ndarray,
    deviation: np.ndarray,
    *,
    misfit: np.ndarray | None = None,
) -> np.ndarray:
    """Return the covariance (F, J, 3, 3), m^2, of the joints of poses (F, D).

    information: (F, D, D) of the refinement, zero where nothing was refined; the covariance of such
    a frame is NaN, because the calibration holds for refined poses only. deviation: (F, D) of the
    particles. misfit: (F,) of the poses; none is known by default. See `Estimate`.
    """
    raw = raw_covariance(body, poses, information, deviation)
    floors = np.array([FLOORS.get(sideless(name), OTHER_FLOOR) for name in body.joint_names])
    covariance: np.ndarray = SCALE**2 * raw + floors[:, None, None] ** 2 * np.eye(3)
    covariance[np.einsum("fdd->f", information) <= 0] = np.nan
    if misfit is not None:
        covariance *= np.fmax(1.0, misfit / SOUND_MISFIT)[:, None, None, None] ** 2
    return covariance


def raw_covariance(
    body: BodyModel, poses: np.ndarray, information: np.ndarray, deviation: np.ndarray
) -> np.ndarray:
    """Return the covariance (F, J, 3, 3) m^2 before any calibration."""
    spread = deviation[:, :, None] ** 2 * np.eye(body.n_dof)
    known = np.einsum("fdd->f", information) > 0
    spread[known] += np.linalg.inv(information[known])
    slopes = _joint_slopes(body, poses)
    # products of matrices, frame by frame: no frame's result depends on the others, to the bit
    return slopes.swapaxes(2, 3) @ spread[:, None] @ slopes


def angle_bands(
    body: BodyModel, poses: np.ndarray, covariance: np.ndarray
) -> dict[str, np.ndarray]:
    """Return how far, degrees (F,), the joint angles of poses (F, D) may be off: half the width of
    the interval that holds 95 %, by the names of `joint_angles`; NaN where the covariance
    (F, J, 3, 3), m^2, of the joints is.

    The pose counts as measured by its joints, each independent of the others, and as known to a
    radian and a metre before. The pelvis, whose joints lie almost on a line, tilts firmly only with
    the trunk: hip flexion is known less well than that of the knee.
    """
    known = np.all(np.isfinite(covariance), axis=(1, 2, 3))
    step, poses = np.sqrt(np.finfo(float).eps), poses[known]
    slopes, axes = _joint_slopes(body, poses), np.eye(body.n_dof)
    measured = slopes @ np.linalg.inv(covariance[known]) @ slopes.swapaxes(2, 3)
    spread = np.linalg.inv(axes + measured.sum(axis=1))
    moved = [joint_angles(body, poses + step * axis) for axis in axes]
    limit, bands = np.sqrt(scipy.special.chdtri(1, 0.05)), {}
    for name, angles in joint_angles(body, poses).items():
        turned = np.stack([other[name] - angles for other in moved], axis=-1)
        slope = np.degrees(np.angle(np.exp(1j * np.radians(turned)))) / step
        bands[name] = np.full(len(known), np.nan)
        bands[name][known] = limit * np.sqrt(np.einsum("fd,fde,fe->f", slope, spread, slope))
    return bands


def _joint_slopes(body: BodyModel, poses: np.ndarray) -> np.ndarray:
    """Return the derivatives (F, J, D, 3) of the joints with respect to poses (F, D)."""
    axes = np.zeros((2, *poses.shape, 3))
    joints = posed_points(body, poses, body.joints, axes)
    bones = np.array([joint.bone for joint in body.joints])
    return bone_point_jacobian(body, poses, bones, joints, axes)


def is_inside_ellipsoid(offsets: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return whether offsets (..., 3), m, lie in the ellipsoids that hold 95 % of the
    probability."""
    solved = np.linalg.solve(covariance, offsets[..., None])[..., 0]
    limit = scipy.special.chdtri(3, 0.05)
    return np.einsum("...a,...a->...", offsets, solved) <= limit
