"""Fit a body's scales and poses to points of it that are seen in space or in pictures.

The unknowns are the poses of M frames and, shared by all frames, the scales of a `ShapeModel` and
the places of the points on the body. The poses are eliminated frame by frame (Schur complement,
Triggs et al. 2000). Networks and models err alike in all frames: together the frames count as
`_INDEPENDENT_FRAMES` observations of what they share.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from apf.body.jacobian import bone_point_jacobian
from apf.body.kinematics import bone_matrices
from apf.body.model import sideless
from apf.body.stature import stature
from apf.initialisation.config import ShapePrior
from apf.initialisation.shape_model import (
    ShapeModel,
    inner_axes,
)
from psfs.cameras.camera import CameraRig
from psfs.common.least_squares import (
    REACH,
    Parameters,
    Residuals,
    Slope,
    differentiate,
    prior,
    solve,
)
from psfs.common.progress import one_blas_thread

#: Independent frames.
_INDEPENDENT_FRAMES = 2.0
#: Standard deviation, m, of a known stature; rad, of an angle from rest.
_STATURE, _ANGLE = 0.001, 1.0
#: Standard deviations of the logs of scales. Size: children, too. Lengths beside the size: those of
#: adults of one stature vary by 3 to 4 % (Gordon et al. 2014, ANSUR II), the size itself is as
#: uncertain.
PRIOR = ShapePrior(size=0.15, length=0.06)


@dataclass(frozen=True, eq=False)
class Fitted:
    """Scales (S,) of a `ShapeModel`, poses (M, D), and offsets (Q, 3) m of observed points from
    where they are expected on the body."""

    shape: np.ndarray
    poses: np.ndarray
    offsets: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def parameters(self) -> Parameters:
        return {"shape": self.shape[None], "poses": self.poses, "offsets": self.offsets}


def fit_body(
    model: ShapeModel,
    evidence: PointEvidence,
    start: Fitted,
    *,
    free: np.ndarray,
    height: float | None = None,
    steps: int = 15,
) -> Fitted:
    """Return the fit of a body to the evidence, from a `start` on.

    free: (S,) bool, the scales that are estimated. height: known stature, m. steps: at most so many
    of the Levenberg-Marquardt method.
    """
    template = model.template
    share = max(1.0, len(start.poses) / _INDEPENDENT_FRAMES) ** -0.5
    angle = np.where(inner_axes(template), _ANGLE, np.inf)

    def measure_stature(shapes: np.ndarray) -> np.ndarray:
        return np.array([[stature(model.body(shape))] for shape in shapes])

    def evaluate(at: Parameters) -> list[Residuals]:
        fitted = Fitted(at["shape"][0], at["poses"], at["offsets"])
        found = evidence.residuals(model, fitted)
        found.append(prior("shape", at["shape"], share * model.deviation))
        found.append(prior("poses", at["poses"], angle, template.rest_pose))
        if height is not None:
            (slope,) = differentiate(measure_stature, at["shape"])
            miss, sigma = measure_stature(at["shape"]) - height, share * _STATURE
            by_shape = [Slope("shape", np.zeros(1, int), slope)]
            found.append(Residuals(miss, by_shape, sigma=sigma, robust=False))
        found.append(prior("offsets", at["offsets"], share * evidence.spread))
        return found

    def move(at: Parameters, step: Parameters) -> Parameters:
        moved = {name: values + step[name] for name, values in at.items()}
        return moved | {"poses": np.clip(moved["poses"], template.lower, template.upper)}

    with one_blas_thread():  # the products are small: BLAS threads would only wait for each other
        solution = solve(
            evaluate, start.parameters, steps=steps, eliminate=["poses"],
            free={"shape": free[None]}, update=move,
        )  # fmt: skip
    found = solution.parameters
    return Fitted(found["shape"][0], found["poses"], found["offsets"])


@dataclass(frozen=True, eq=False)
class PointEvidence:
    """P points fixed to the body, seen in M frames: in space, or in the pictures of V cameras.

    bone: (P,) that each is fixed to. position: (P, 3) m on it, in the template's size. partner:
    (P,) index of the same point on the other side, its own on the midline; partners lie at mirrored
    positions. spreads: (P,) m, standard deviation of each coordinate of the position. places:
    (M, P, 3) m, NaN where unknown, with an error of `noise` m, by default estimated; robust:
    whether some may be wrong. pixels: (V, M, P, 2) undistorted in the pictures of `rig`, which take
    the place of `places`, with errors (V, M, P) px, infinite where a point is not seen.
    """

    bone: np.ndarray
    position: np.ndarray
    partner: np.ndarray
    spreads: np.ndarray
    places: np.ndarray
    noise: float | None = None
    robust: bool = True
    rig: CameraRig | None = None
    pixels: np.ndarray | None = None
    errors: np.ndarray | None = None

    @property
    def mirrors(self) -> tuple[np.ndarray, np.ndarray]:
        """The number (P,) of each point's offset, which partners share, and its signs (P, 3)."""
        first = np.minimum(np.arange(len(self.bone)), self.partner)
        offsets = np.unique(first, return_inverse=True)[1]
        signs = np.ones((len(first), 3))
        signs[first != np.arange(len(first)), 1] = -1
        return offsets, signs

    @property
    def spread(self) -> np.ndarray:
        """Standard deviation (Q, 1) m of the offsets."""
        number = self.mirrors[0]
        return (np.bincount(number, self.spreads) / np.bincount(number))[:, None]

    def positions(self, model: ShapeModel, at: Fitted) -> np.ndarray:
        """Return the positions (P, 3) m of the points on their bones."""
        groups = model.template.scale_groups
        group = np.array([groups.index(sideless(bone.name)) for bone in model.template.bones])
        scale = np.exp(at.shape[0] + at.shape[2 : 2 + len(groups)])[group[self.bone]]
        number, signs = self.mirrors
        placed: np.ndarray = self.position * scale[:, None] + signs * at.offsets[number]
        return placed

    def locate(self, model: ShapeModel, at: Fitted) -> np.ndarray:
        """Return the points (M, P, 3) m in the world."""
        rotations, origins = bone_matrices(model.body(at.shape), at.poses)
        turned = rotations[:, self.bone] @ self.positions(model, at)[:, :, None]
        return origins[:, self.bone] + turned[..., 0]

    def residuals(self, model: ShapeModel, at: Fitted) -> list[Residuals]:
        points = self.locate(model, at)
        n_frames, n_points = points.shape[:2]
        body = model.body(at.shape)
        number, signs = self.mirrors
        by_pose = bone_point_jacobian(body, at.poses, self.bone, points).swapaxes(2, 3)
        by_offset = bone_matrices(body, at.poses)[0][:, self.bone] * signs[:, None]
        by_shape = np.zeros((*points.shape, len(at.shape)))
        step = 1e-5  # small against any scale, large against float64's resolution
        for scale in np.flatnonzero(model.moves_points):
            moved = at.shape + step * np.eye(len(at.shape))[scale]
            other = self.locate(model, Fitted(moved, at.poses, at.offsets))
            by_shape[..., scale] = (other - points) / step
        frame, point = np.divmod(np.arange(n_frames * n_points), n_points)
        slopes = [
            Slope(name, items, values.reshape(len(frame), 3, -1))
            for name, items, values in (
                ("poses", frame, by_pose),
                ("shape", 0 * frame, by_shape),
                ("offsets", number[point], by_offset),
            )
        ]
        if self.pixels is None:
            return [
                Residuals(
                    (points - self.places).reshape(-1, 3),
                    slopes,
                    sigma=self.noise,
                    robust=self.robust,
                )
            ]
        return self._project(points.reshape(-1, 3), slopes)

    def _project(self, points: np.ndarray, slopes: Sequence[Slope]) -> list[Residuals]:
        """Return the residuals, px, of the points (K, 3) in the pictures."""
        assert self.rig is not None and self.pixels is not None and self.errors is not None
        found = []
        for camera, pixels, errors in zip(self.rig, self.pixels, self.errors, strict=True):
            seen = np.flatnonzero(np.isfinite(errors.ravel()))
            sigma = errors.ravel()[seen]
            local = points[seen] @ camera.R.T + camera.t
            depth = np.maximum(local[:, 2:], 0.05)
            plane = local[:, :2] / depth
            gap = plane @ camera.K[:2, :2].T + camera.K[:2, 2] - pixels.reshape(-1, 2)[seen]
            turned = camera.R[:2] - plane[:, :, None] * camera.R[2]
            by_point = camera.K[:2, :2] @ (turned / depth[:, :, None])
            by = [Slope(of.name, of.items[seen], by_point @ of.values[seen]) for of in slopes]
            found.append(Residuals(gap, by, sigma=sigma))
        return found

    def missed_shares(self, model: ShapeModel, at: Fitted) -> tuple[np.ndarray, np.ndarray]:
        """Return the lengths (V, M, P) px of the reprojection residuals, NaN where a point is not
        seen, and the share (M,) of the sightings that each frame's pose misses."""
        assert self.errors is not None
        lengths = np.full(self.errors.shape, np.nan)
        found = self._project(self.locate(model, at).reshape(-1, 3), ())
        for view, of in enumerate(found):
            lengths[view][np.isfinite(self.errors[view])] = np.linalg.norm(of.values, axis=1)
        square = (lengths / self.errors) ** 2
        return lengths, np.nanmean(square / (square + REACH**2), axis=(0, 2))
