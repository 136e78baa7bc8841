"""How well the poses of a track agree with the silhouettes of their frames."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from collections.abc import Sequence as Items
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from apf.body.cones import distances, outlines
from apf.body.kinematics import posed_cones
from apf.report.overlay import checked_indices
from apf.report.parts import Part, parts_of
from apf.tracking.track import Track
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.footprints import footprints
from psfs.common.regions import iou
from psfs.diagnostics.reprojection_iou import volume_region, whole_silhouettes
from psfs.session import Session
from psfs.voxels.grid import VoxelCloud, VoxelGrid
from psfs.voxels.host_voxels import voxel_silhouette

#: Frames that are looked at, evenly spread over a longer track: enough for curves on a page.
MOST_FRAMES = 200
#: A part that covers fewer pixels of a picture says nothing there.
_LEAST_PIXELS = 20
#: m from every cone beyond which a surface voxel is not explained: about a forearm's girth, more
#: than hulls of few cameras are thicker than flesh.
_FAR = 0.10


@dataclass(frozen=True, eq=False)
class Agreement:
    """What was found in S of a track's frames.

    rows: (S,) of the track. cameras: (V,) names. body_iou, voxel_iou: (S, V) IoU of the posed body
    and of the voxels with the silhouettes, NaN where there is nothing to compare. inside: (S, P)
    share of each part's worst cone that lies in the silhouettes, the mean over the cameras that
    show it, NaN where none does. explained: (S,) share of the surface voxels that lie at some cone.
    clouds: the voxels.
    """

    rows: np.ndarray
    cameras: tuple[str, ...]
    body_iou: np.ndarray
    voxel_iou: np.ndarray
    inside: np.ndarray
    explained: np.ndarray
    clouds: tuple[VoxelCloud, ...]


def shown_rows(n_frames: int, most: int = MOST_FRAMES) -> np.ndarray:
    """Return the rows, evenly spaced, of a track of `n_frames` that are looked at."""
    return np.arange(0, n_frames, max(1, -(-n_frames // most)))


def compare_with_silhouettes(
    session: Session,
    grid: VoxelGrid,
    track: Track,
    progress: Callable[[], object] | None = None,
) -> Agreement:
    """Compare body and voxels in the `shown_rows` of the track with the silhouettes that the voxels
    in `grid` were carved from, see `Session.carved`. progress: called after each frame."""
    rows, rig, body = shown_rows(len(track)), session.rig, track.its_body
    parts, drawn = parts_of(body), [i for i, cone in enumerate(body.cones) if cone.in_images]
    region, extents = volume_region(rig, grid), footprints(rig, grid.voxel_size)
    cones = posed_cones(body, track.poses[rows])
    found = defaultdict[str, list[Any]](list)
    clouds = []
    indices = checked_indices(session.sequence, track.frames[rows])
    for number, frame in enumerate(session.carved(grid, indices)):
        shown, cloud = whole_silhouettes(frame.silhouettes, region), frame.cloud
        scores = np.array([
            _scores(camera, cones[number], drawn, silhouette)
            for camera, silhouette in zip(rig, shown, strict=True)
        ])  # fmt: skip
        found["body_iou"].append(scores[:, 0])
        found["inside"].append(_worst_of(scores[:, 1:], drawn, parts))
        found["explained"].append(_explained(cloud.centres, cones[number]))
        found["voxel_iou"].append(_voxel_iou(rig, extents, cloud.centres, shown))
        clouds.append(cloud)
        if progress is not None:
            progress()
    figures = {name: np.array(values) for name, values in found.items()}
    return Agreement(rows, tuple(rig.names), clouds=tuple(clouds), **figures)


def _voxel_iou(
    rig: CameraRig, extents: np.ndarray, centres: np.ndarray, shown: np.ndarray
) -> np.ndarray:
    """Return the IoU (V,) of voxels with `centres` (N, 3) m and the silhouettes (V, H, W) bool."""
    ours = [
        voxel_silhouette(camera, centres, extent, shown.shape[1:])
        for camera, extent in zip(rig, extents, strict=True)
    ]
    return np.array([iou(one, other) for one, other in zip(ours, shown, strict=True)])


def _scores(
    camera: Camera, cones: np.ndarray, drawn: Items[int], silhouette: np.ndarray
) -> np.ndarray:
    """Return the IoU of posed cones (C, 16) with a silhouette (H, W) bool, then the share of each
    of the `drawn` ones in it, (1 + n,); NaN where too little is seen."""
    corners = outlines(camera, cones)
    whole = np.zeros(silhouette.shape, np.uint8)
    scores = np.full(1 + len(cones), np.nan)
    for number, quad in enumerate(corners):
        if not np.isfinite(quad).all():
            continue
        shape = np.zeros_like(whole)
        cv2.fillConvexPoly(shape, cv2.convexHull(np.rint(quad).astype(np.int32)), 1)
        shape[camera.size[1] :], shape[:, camera.size[0] :] = 0, 0
        pixels = np.count_nonzero(shape)
        if pixels >= _LEAST_PIXELS:
            scores[1 + number] = np.count_nonzero(shape & silhouette) / pixels
        whole |= shape
    scores[0] = iou(whole > 0, silhouette)
    return scores[[0, *(1 + cone for cone in drawn)]]


def _worst_of(shares: np.ndarray, drawn: Items[int], parts: tuple[Part, ...]) -> np.ndarray:
    """Return (P,): of shares (V, n) of the `drawn` cones the mean over the cameras, and of these
    that of each part's worst cone; NaN where none is seen."""
    means = dict(zip(drawn, np.ma.masked_invalid(shares).mean(axis=0), strict=True))
    worst = [np.ma.min([means[cone] for cone in part.cones if cone in means]) for part in parts]
    return np.array([np.nan if np.ma.is_masked(value) else value for value in worst], float)


def _explained(points: np.ndarray, cones: np.ndarray) -> float:
    """Return the share of points (N, 3) m at posed cones (C, 16); NaN without points."""
    if not len(points):
        return np.nan
    return float((distances(points, cones).min(axis=1) <= _FAR).mean())
