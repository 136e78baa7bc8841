"""Initialise a calibration from a wand: essential matrices of camera pairs, scaled by its
length."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, product

import cv2
import numpy as np

from cl import InputError
from psfs.calibration.scene import BAD, CalibrationScene, rigid_transform
from psfs.calibration.start.board import choose_best_pose
from psfs.calibration.start.placing import FOCALS, place_along, with_focal_length
from psfs.calibration.targets.target import EQUAL, Sighting, Target, group_by_frame
from psfs.cameras.camera import Camera
from psfs.cameras.triangulation import intersect_rays

#: Most camera pairs that judge a focal length, and that propose a frame's wand pose.
_JUDGES, _PROPOSERS = 4, 6


#: Transform (4, 4) from a camera to another, m, and how badly the wand's length fits: its median
#: relative deviation, and the share of frames that do not agree.
_RelativePose = tuple[np.ndarray, float]


def place_cameras_by_wand(
    cameras: Sequence[Camera],
    target: Target,
    sightings: Sequence[Sighting],
    pairs: Sequence[tuple[int, int]],
) -> tuple[CalibrationScene, list[Sighting]]:
    """Place the cameras along the `pairs` and estimate the wand's poses.

    Returns them with the sightings, their points in the order that fits. Raises InputError for a
    pair that no motion explains.
    """
    relative = {}
    for a, b in pairs:
        pose = _estimate_relative_pose(cameras, target, sightings, (a, b))
        if pose is None:
            raise InputError(
                f"the markers that {cameras[a].name} and {cameras[b].name} see do not belong "
                f"together; expected a {target.name}, the only bright spots that move, and cameras "
                "that run together"
            )
        relative[a, b] = pose[0]
    rig, _ = place_along(cameras, relative)
    poses: dict[int, np.ndarray] = {}
    ordered: list[Sighting] = []
    for frame, here in group_by_frame(sightings).items():
        if len(here) > 1:
            poses[frame], fitting = choose_best_pose(
                rig, target, here, _propose_poses(rig, target, here)
            )
            ordered += fitting
    return CalibrationScene(rig, target, poses), ordered


def estimate_focal_lengths(
    cameras: Sequence[Camera],
    target: Target,
    sightings: Sequence[Sighting],
    pairs: Sequence[tuple[int, int]],
) -> list[Camera]:
    """Return the cameras with the focal length that keeps the wand's length most constant.

    The focal length is the same for all, in units of the pictures' longer sides.
    """

    def with_focal(share: float) -> list[Camera]:
        return [with_focal_length(camera, share) for camera in cameras]

    def cost(share: float) -> float:
        rig = with_focal(share)
        poses = [_estimate_relative_pose(rig, target, sightings, pair) for pair in pairs[:_JUDGES]]
        return float(np.mean([1.0 if pose is None else pose[1] for pose in poses]))

    return with_focal(min(FOCALS, key=cost))


def _estimate_relative_pose(
    cameras: Sequence[Camera],
    target: Target,
    sightings: Sequence[Sighting],
    pair: tuple[int, int],
) -> _RelativePose | None:
    """Estimate a pair's relative pose by RANSAC over all possible orders of the wand's points.

    None if no essential matrix explains them.
    """
    a, b = pair
    seen = {(s.frame, s.view): s for s in sightings if s.view in pair}
    frames = [frame for frame, view in seen if view == a and (frame, b) in seen]
    pixels = [np.stack([seen[frame, view].pixels for frame in frames]) for view in pair]
    one, two = (
        cameras[view].normalise(of.reshape(-1, 2)).reshape(of.shape)
        for view, of in zip(pair, pixels, strict=True)
    )
    orders = target.orders
    first = np.repeat(one, len(orders), axis=0).reshape(-1, 2)
    second = two[:, orders].reshape(-1, 2)
    focal = np.sqrt(cameras[a].K[0, 0] * cameras[b].K[0, 0])
    cv2.setRNGSeed(0)
    E, inliers = cv2.findEssentialMat(
        first, second, np.eye(3), cv2.RANSAC, 0.9999, BAD / focal, maxIters=5000
    )
    if E is None or E.shape != (3, 3):
        return None
    agreeing = np.all(inliers.reshape(len(frames), len(orders), -1), axis=-1, keepdims=True)[..., 0]
    best = [(row, int(agreeing[row].argmax())) for row in range(len(frames)) if agreeing[row].any()]
    if len(best) < 5:
        return None
    rows = np.array([row for row, _ in best])
    left, right = one[rows], two[rows][np.arange(len(rows))[:, None], orders[[o for _, o in best]]]
    flat = left.reshape(-1, 2), right.reshape(-1, 2)
    _, R, t, _, points = cv2.recoverPose(E, *flat, np.eye(3), distanceThresh=1e9)
    points = (points[:3] / points[3]).T.reshape(len(rows), -1, 3)
    return _scale_by_wand(R, t, points, target, len(frames))


def _scale_by_wand(
    R: np.ndarray, t: np.ndarray, points: np.ndarray, target: Target, frames: int
) -> _RelativePose | None:
    """Scale a relative pose by the wand's length; points: (F, P, 3), still without scale."""
    lengths = np.linalg.norm(points[:, -1] - points[:, 0], axis=-1)
    middle = float(np.median(lengths))
    if not 0 < middle < np.inf:
        return None
    right = np.abs(lengths / middle - 1) < EQUAL - 1
    scale = float(np.linalg.norm(target.points[-1] - target.points[0])) / middle
    spread = float(np.median(np.abs(lengths / middle - 1)))
    return rigid_transform(R, scale * t), spread + 1 - float(right.sum() / frames)


def _propose_poses(
    rig: Sequence[Camera], target: Target, sightings: Sequence[Sighting]
) -> list[np.ndarray]:
    """Propose poses (4, 4) of the wand in a frame.

    One for every pair of its sightings and every order of the second one's points.
    """
    proposals = []
    views = [(rig[s.view].centre, rig[s.view].rays(s.pixels)) for s in sightings]
    pairs = list(combinations(views, 2))[:_PROPOSERS]
    for ((centre, rays), (other, others)), order in product(pairs, target.orders):
        points = intersect_rays(np.stack([centre, other]), np.stack([rays, others[order]], axis=1))
        axis = points[-1] - points[0]
        length = np.linalg.norm(axis)
        if not 0 < length < np.inf:
            continue
        for end in (points, points[::-1]) if len(target.orders) == 1 else (points,):
            proposals.append(_pose_along(target, end))
    return proposals or [np.eye(4)]


def _pose_along(target: Target, points: np.ndarray) -> np.ndarray:
    """Return a pose (4, 4) of the wand with its points at `points` (P, 3), its roll arbitrary."""
    x = points[-1] - points[0]
    x = x / np.linalg.norm(x)
    z = np.cross(x, np.eye(3)[np.abs(x).argmin()])
    z /= np.linalg.norm(z)
    R = np.stack([x, np.cross(z, x), z], -1)
    return rigid_transform(R, points.mean(0) - R @ target.points.mean(0))
