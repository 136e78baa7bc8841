"""The start of a calibration from a wand: essential matrices of pairs, in the wand's scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product

import cv2
import numpy as np

from cl import InputError
from psfs.calibration.scene import Scene, normalised, placed, rigid
from psfs.calibration.start.board import best_pose
from psfs.calibration.start.placing import chained
from psfs.calibration.targets.target import Sighting, Target, by_frame
from psfs.cameras.camera import Camera

#: Errors of points that agree with an essential matrix, px.
_AGREES = 3.0
#: Share by which the wand may seem longer or shorter in a frame that agrees.
_LENGTH = 0.1
#: Focal lengths that are tried where none is known, of the longer side of the picture.
_FOCALS = np.geomspace(0.5, 2.5, 9)
#: Pairs of cameras by which a focal length is judged, and by which a frame's wand is proposed.
_JUDGES, _PROPOSERS = 4, 6


@dataclass(frozen=True, eq=False)
class _Relation:
    """How two cameras stand to each other. motion: (4, 4) from the first to the second, m.
    spread: relative deviation of the wand's length in the frames that agree. share: of these."""

    motion: np.ndarray
    spread: float
    share: float


def wand_scene(
    cameras: Sequence[Camera],
    target: Target,
    sightings: Sequence[Sighting],
    pairs: Sequence[tuple[int, int]],
    names: Sequence[str],
) -> tuple[Scene, list[Sighting]]:
    """Return cameras, placed along the `pairs`, and the wand's poses; and the sightings with their
    points in the order that fits. Raises InputError for a pair that no motion explains."""
    relative = {}
    for a, b in pairs:
        found = _relation(cameras, target, sightings, (a, b))
        if found is None:
            raise InputError(
                f"the markers that {names[a]} and {names[b]} see do not belong together; expected "
                f"a {target.name}, the only bright spots that move, and cameras that run together"
            )
        relative[a, b] = found.motion
    places = chained(pairs, relative)
    rig = tuple(placed(camera, places[view]) for view, camera in enumerate(cameras))
    poses: dict[int, np.ndarray] = {}
    ordered: list[Sighting] = []
    for frame, here in by_frame(sightings).items():
        if len(here) > 1:
            poses[frame], fitting = best_pose(rig, target, here, _proposals(rig, target, here))
            ordered += fitting
    return Scene(rig, poses), ordered


def likely_cameras(
    cameras: Sequence[Camera],
    target: Target,
    sightings: Sequence[Sighting],
    pairs: Sequence[tuple[int, int]],
) -> list[Camera]:
    """Return the cameras with the focal length, the same for all in shares of the pictures' longer
    sides, with which the wand keeps its length best."""

    def with_focal(share: float) -> list[Camera]:
        changed = []
        for camera in cameras:
            K = camera.K.copy()
            K[0, 0] = K[1, 1] = share * max(camera.size)
            changed.append(replace(camera, K=K))
        return changed

    def cost(share: float) -> float:
        rig = with_focal(share)
        found = [_relation(rig, target, sightings, pair) for pair in pairs[:_JUDGES]]
        return float(np.mean([1.0 if of is None else of.spread + 1 - of.share for of in found]))

    return with_focal(min(_FOCALS, key=cost))


def _relation(
    cameras: Sequence[Camera],
    target: Target,
    sightings: Sequence[Sighting],
    pair: tuple[int, int],
) -> _Relation | None:
    """Return how a pair stands, by RANSAC over all the orders in which its cameras may have taken
    the wand's points; None where no essential matrix explains them."""
    a, b = pair
    seen = {(s.frame, s.view): s for s in sightings if s.view in pair}
    frames = [frame for frame, view in seen if view == a and (frame, b) in seen]
    one = np.stack([normalised(cameras[a], seen[f, a].pixels) for f in frames])
    two = np.stack([normalised(cameras[b], seen[f, b].pixels) for f in frames])
    orders = target.orders
    first = np.repeat(one, len(orders), axis=0).reshape(-1, 2)
    second = two[:, orders].reshape(-1, 2)
    focal = np.sqrt(cameras[a].K[0, 0] * cameras[b].K[0, 0])
    cv2.setRNGSeed(0)
    E, inliers = cv2.findEssentialMat(
        first, second, np.eye(3), cv2.RANSAC, 0.9999, _AGREES / focal, maxIters=5000
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
    return _in_scale(R, t, points, target, len(frames))


def _in_scale(
    R: np.ndarray, t: np.ndarray, points: np.ndarray, target: Target, frames: int
) -> _Relation | None:
    """Return the relation with the length of the wand, whose points (F, P, 3) have none yet."""
    lengths = np.linalg.norm(points[:, -1] - points[:, 0], axis=-1)
    middle = float(np.median(lengths))
    if not 0 < middle < np.inf:
        return None
    right = np.abs(lengths / middle - 1) < _LENGTH
    scale = float(np.linalg.norm(target.points[-1] - target.points[0])) / middle
    spread = float(np.median(np.abs(lengths / middle - 1)))
    return _Relation(rigid(R, scale * t), spread, float(right.sum() / frames))


def _proposals(
    rig: Sequence[Camera], target: Target, sightings: Sequence[Sighting]
) -> list[np.ndarray]:
    """Return poses (4, 4) of the wand in a frame: by every pair of its sightings, and every order
    of the second one's points."""
    found = []
    pairs = list(combinations(sightings, 2))[:_PROPOSERS]
    for (one, two), order in product(pairs, target.orders):
        points = _triangulated(rig[one.view], rig[two.view], one.pixels, two.pixels[order])
        axis = points[-1] - points[0]
        length = np.linalg.norm(axis)
        if not 0 < length < np.inf:
            continue
        for end in (points, points[::-1]) if len(target.orders) == 1 else (points,):
            found.append(_along(target, end))
    return found or [np.eye(4)]


def _along(target: Target, points: np.ndarray) -> np.ndarray:
    """Return the pose (4, 4) of the wand whose points are seen at `points` (P, 3), its turn about
    itself being any."""
    x = points[-1] - points[0]
    x = x / np.linalg.norm(x)
    z = np.cross(x, np.eye(3)[np.abs(x).argmin()])
    z /= np.linalg.norm(z)
    R = np.stack([x, np.cross(z, x), z], -1)
    return rigid(R, points.mean(0) - R @ target.points.mean(0))


def _triangulated(a: Camera, b: Camera, one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Return the points (N, 3) that two cameras see at pixels (N, 2)."""
    P, Q = (np.hstack([camera.R, camera.t[:, None]]) for camera in (a, b))
    points = cv2.triangulatePoints(P, Q, normalised(a, one).T, normalised(b, two).T)
    with np.errstate(divide="ignore", invalid="ignore"):
        found: np.ndarray = (points[:3] / points[3]).T
    return np.nan_to_num(found, nan=0.0, posinf=1e6, neginf=-1e6)
