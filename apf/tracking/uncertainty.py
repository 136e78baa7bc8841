"""How far joints may lie from where a track puts them.

The refinement's linear system says how firmly the voxels hold every angle: an arm that hides
before the trunk is held by few. Its inverse, and the spread of the particles, are carried to the
joints and scaled so that, on synthetic sequences, the stated ellipsoids hold the truth as often as
they say (see scripts/calibrate_uncertainty.py), as long as no limb is lost. A floor per joint
stands for what no search mends: the voxels' resolution, and joint centres that lie elsewhere in the
body than the model's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.stats import chi2

from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel, sideless

#: Of the derivatives by differences, m or rad.
_STEP = 1e-4


@dataclass(frozen=True)
class Calibration:
    """How stated deviations become those that hold; see `CALIBRATION` for the values used."""

    scale: float = 1.0
    """Factor of the stated deviations."""
    floor: Mapping[str, float] = field(default_factory=dict)
    """m, deviation that every coordinate of a joint has at least, by name without its side."""
    other_floor: float = 0.03
    """m, of joints that have none: amid those of `CALIBRATION`."""

    def floors(self, names: list[str]) -> np.ndarray:
        """Return the floors (J,), m, of the joints of these names."""
        return np.array([self.floor.get(sideless(name), self.other_floor) for name in names])


#: By scripts/calibrate_uncertainty.py on one track of each of the suite's sequences but the walk
#: with eight cameras, and a tenth more: what the others say of one that was left out holds 83 to
#: 98 %.
CALIBRATION = Calibration(
    scale=2.0,
    floor={
        "pelvis": 0.011,
        "neck": 0.013,
        "head_top": 0.013,
        "shoulder": 0.024,
        "elbow": 0.025,
        "wrist": 0.023,
        "hip": 0.016,
        "knee": 0.016,
        "ankle": 0.010,
    },
)


def joint_covariance(
    body: BodyModel,
    poses: np.ndarray,
    information: np.ndarray,
    deviation: np.ndarray,
    calibration: Calibration = CALIBRATION,
) -> np.ndarray:
    """Return the covariance (F, J, 3, 3) m^2 of the joints of poses (F, D).

    information: (F, D, D) of the refinement, zero where nothing was refined; deviation: (F, D) of
    the particles. See `Estimate`.
    """
    raw = raw_covariance(body, poses, information, deviation)
    floors = calibration.floors(body.joint_names)
    return calibration.scale**2 * raw + floors[:, None, None] ** 2 * np.eye(3)


def raw_covariance(
    body: BodyModel, poses: np.ndarray, information: np.ndarray, deviation: np.ndarray
) -> np.ndarray:
    """Return the covariance (F, J, 3, 3) m^2 before any calibration."""
    n_joints = len(body.joints)
    spread = deviation[:, :, None] ** 2 * np.eye(body.n_dof)
    known = np.einsum("fdd->f", information) > 0
    spread[known] += np.linalg.inv(information[known])
    out = np.empty((len(poses), n_joints, 3, 3))
    steps = _STEP * np.eye(body.n_dof)
    for frame in range(len(poses)):  # alone: the same to the bit, whatever it is computed with
        block = slice(frame, frame + 1)
        moved = poses[block, None, None] + np.stack([steps, -steps])
        n = len(moved)
        joints = posed_joints(body, moved.reshape(-1, body.n_dof))
        ahead, behind = np.moveaxis(joints.reshape(n, 2, body.n_dof, n_joints, 3), 1, 0)
        slopes = (ahead - behind) / (2 * _STEP)
        out[block] = np.einsum("fdja,fde,fejb->fjab", slopes, spread[block], slopes, optimize=True)
    return out


def inside(offsets: np.ndarray, covariance: np.ndarray, share: float = 0.95) -> np.ndarray:
    """Return whether offsets (..., 3) m lie in the ellipsoids that should hold `share` of them."""
    solved = np.linalg.solve(covariance, offsets[..., None])[..., 0]
    return np.einsum("...a,...a->...", offsets, solved) <= chi2.ppf(share, 3)
