"""Lenses of cameras, usual or estimated, and places from pairs that see the target together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import cv2
import numpy as np
import scipy

from cl import InputError
from psfs.calibration.scene import place_camera
from psfs.calibration.targets.target import Sighting, Target, group_by_frame
from psfs.cameras.camera import Camera
from psfs.common.numbers import pick_evenly

#: Default focal length of an unknown camera, in units of the longer side of its picture.
_DEFAULT_FOCAL = 1.1
#: Range of plausible focal lengths, in longer sides; outside it the estimate is rejected.
_FOCAL_RANGE = (0.3, 10.0)
#: Focal lengths that are tried for an unknown lens, in longer sides.
FOCALS = np.geomspace(0.5, 3.0, 25)
#: Pictures of the board below which a simple lens is assumed.
_FEW = 4
#: A picture is left out if its error exceeds this times the median.
_MAX_RELATIVE_ERROR = 3.0


def default_camera(name: str, size: tuple[int, int], focal: float = _DEFAULT_FOCAL) -> Camera:
    """Return a camera at the origin without distortion; focal: in units of the longer side."""
    f = focal * max(size)
    K = np.array([[f, 0, (size[0] - 1) / 2], [0, f, (size[1] - 1) / 2], [0, 0, 1.0]])
    return Camera(name, K, np.zeros(5), np.eye(3), np.zeros(3), size)


def with_focal_length(camera: Camera, share: float) -> Camera:
    """Return the camera with another focal length, in units of the longer side."""
    return camera.refocused(share * max(camera.size) / camera.K[0, 0])


def estimate_camera_from_boards(
    name: str, size: tuple[int, int], target: Target, sightings: Sequence[Sighting]
) -> Camera:
    """Estimate a camera from pictures of the board (cv2.calibrateCamera; k1 k2 p1 p2).

    Returns the default camera if the pictures do not determine it.
    """
    usual = default_camera(name, size)
    chosen = [sightings[k] for k in pick_evenly(len(sightings))]
    if len(chosen) < 3:
        return usual
    try:
        K, lens, off = _calibrate(size, target, chosen)
        sound = off < max(
            _MAX_RELATIVE_ERROR * float(np.median(off)), 1.0
        )  # false detections spoil the lens
        if 3 <= sound.sum() < len(chosen):
            chosen = [sighting for sighting, good in zip(chosen, sound, strict=True) if good]
            K, lens, _ = _calibrate(size, target, chosen)
    except cv2.error:  # all boards are parallel to the picture
        return usual
    focal = np.array([K[0, 0], K[1, 1]]) / max(size)
    if not (
        np.isfinite(K).all() and focal.min() > _FOCAL_RANGE[0] and focal.max() < _FOCAL_RANGE[1]
    ):
        return usual
    return Camera(name, K, lens[:5], np.eye(3), np.zeros(3), size)


def _calibrate(
    size: tuple[int, int], target: Target, sightings: Sequence[Sighting]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return K (3, 3), distortion (5,) and every picture's error, px."""
    flags = cv2.CALIB_FIX_K3
    if len(sightings) < _FEW:
        flags |= cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_PRINCIPAL_POINT
    points = [target.points[s.ids].astype(np.float32) for s in sightings]
    pixels = [s.pixels.astype(np.float32)[:, None] for s in sightings]
    nothing: Any = None
    result = cv2.calibrateCameraExtended(points, pixels, size, nothing, nothing, flags=flags)
    return result[1], result[2].ravel(), result[-1].ravel()


Pair = tuple[int, int]
#: Frames with the target below which a camera sees too little; and fewest that two cameras share so
#: that one can be placed by the other: with a wand, of which a picture tells little, and with a
#: board, whose pose each picture tells.
FEW_FRAMES, FEW_WANDS, FEW_BOARDS = 12, 10, 3


def count_shared_frames(sightings: Sequence[Sighting], views: int) -> np.ndarray:
    """Count the frames in which two cameras see the target together (V, V); diagonal: one camera
    alone."""
    counts = np.zeros((views, views), int)
    for frame_sightings in group_by_frame(sightings).values():
        here = [sighting.view for sighting in frame_sightings]
        counts[np.ix_(here, here)] += 1
    return counts


def check_linked(counts: np.ndarray, fewest: int, names: Sequence[str], what: str) -> None:
    """Raise InputError unless pairs that share `fewest` frames with the target link all cameras."""
    shared = counts - np.diag(np.diag(counts))
    groups, group = scipy.sparse.csgraph.connected_components(
        scipy.sparse.csr_matrix(shared >= fewest), directed=False
    )
    if groups == 1:
        return
    members = [[names[int(v)] for v in np.flatnonzero(group == g)] for g in range(groups)]
    members.sort(key=len, reverse=True)
    parts = " | ".join(" ".join(group_names) for group_names in members)
    between = max(
        int(shared[np.ix_(group == a, group == b)].max()) for a, b in combinations(range(groups), 2)
    )
    ask = f"expected {fewest} or more: hold the {what} where such cameras see it at once"
    if len(members[0]) == 1:
        raise InputError(
            f"too few common views: two cameras see the {what} together in {between} frames at "
            f"most; {ask}"
        )
    if len(members) == 2 and len(members[1]) == 1:
        raise InputError(
            f"too few common views: {members[1][0]} sees the {what} together with another camera "
            f"in {between} frames at most; {ask}"
        )
    raise InputError(
        f"the cameras are in {groups} groups ({parts}) that share {between} frames with the "
        f"{what} at most; {ask}"
    )


def find_spanning_pairs(counts: np.ndarray, fewest: int) -> list[Pair]:
    """Return pairs of cameras (known, new) that form a tree over all cameras with most shared
    frames.

    The first pair begins at the camera that shares most.
    """
    shared = np.where(counts >= fewest, counts, 0)
    np.fill_diagonal(shared, 0)
    weights = np.divide(1.0, shared, out=np.zeros(shared.shape), where=shared > 0)
    tree = scipy.sparse.csgraph.minimum_spanning_tree(scipy.sparse.csr_matrix(weights))
    root = int(shared.sum(axis=1).argmax())
    order, before = scipy.sparse.csgraph.breadth_first_order(tree, root, directed=False)
    return [(int(before[view]), int(view)) for view in order[1:]]


def place_along(
    cameras: Sequence[Camera], relative: Mapping[Pair, np.ndarray]
) -> tuple[tuple[Camera, ...], dict[int, np.ndarray]]:
    """Return all cameras in the frame of the first one, and their poses (4, 4).

    relative: transform from the known camera of a pair to the new one, pair after pair.
    """
    poses = {next(iter(relative))[0]: np.eye(4)}
    for (known, new), transform in relative.items():
        poses[new] = transform @ poses[known]
    return tuple(place_camera(camera, poses[v]) for v, camera in enumerate(cameras)), poses
