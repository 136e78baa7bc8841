"""Measure the agreement of a track's poses with the silhouettes and keypoints of their frames."""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Sequence as Items
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from apf.body.cones import project_outlines
from apf.body.kinematics import posed_cones
from apf.body.limbs import LIMB_ENDS, limb_chains
from apf.body.model import BodyModel
from apf.keypoints.keypoints import Keypoints
from apf.keypoints.landmarks import locate_points
from apf.report.drawing import check_indices
from apf.tracking.limb_confidence import SAME_PLACE
from apf.tracking.track import Track
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.config import TriangulationConfig
from psfs.cameras.rig_geometry import voxel_footprints
from psfs.cameras.triangulation import reprojection_errors, undistort_points
from psfs.common.cones import cone_distances
from psfs.common.progress import map_in_threads
from psfs.common.regions import iou
from psfs.diagnostics.reprojection_iou import score_voxels, volume_region, whole_silhouettes
from psfs.session import CarvedFrame, Session
from psfs.voxels.grid import VoxelCloud, VoxelGrid

#: Most frames that are compared, evenly spread over the track: enough for a page's curves.
MOST_FRAMES = 100
#: A cone with fewer pixels in a picture is not scored there.
_LEAST_PIXELS = 20
#: A surface voxel farther than this from every cone, m, is unexplained: about a forearm's girth,
#: and more than the hulls of few cameras exceed the body.
VOXEL_FAR = 0.10


@dataclass(frozen=True)
class Part:
    """A part of a body with its usual name; cones: indices; end: index of its last joint."""

    name: str
    cones: tuple[int, ...]
    end: int


def find_parts(body: BodyModel) -> tuple[Part, ...]:
    """Return trunk, limbs and head of `body`, as far as it has them."""
    numbers = {name: number for number, name in enumerate(body.joint_names)}
    ends = {numbers[joint]: name for name, joint in LIMB_ENDS.items() if joint in numbers}
    heads = [{body.joints[end].bone} for end, name in ends.items() if name == "head"]
    limbs = [set(chain) for chain in limb_chains(body)] + heads
    trunk = set(range(len(body.bones))).difference(*limbs)
    found = [_part(body, trunk, "trunk")]
    for bones in limbs:
        names = [name for end, name in ends.items() if body.joints[end].bone in bones]
        found.append(_part(body, bones, names[0] if names else body.bones[max(bones)].name))
    images = {c for c, cone in enumerate(body.cones) if cone.in_images}
    return tuple(part for part in found if images & set(part.cones) and part.end >= 0)


def _part(body: BodyModel, bones: set[int], name: str) -> Part:
    cones = tuple(c for c, cone in enumerate(body.cones) if cone.bone in bones)
    joints = [j for j, joint in enumerate(body.joints) if joint.bone in bones]
    return Part(name, cones, joints[-1] if joints else -1)


@dataclass(frozen=True, eq=False)
class Agreement:
    """Agreement of a track with the silhouettes in S of its frames.

    rows: (S,) of the track. cameras: (V,) names. body_iou, voxel_iou: (S, V) IoU of the posed body
    and of the voxels with the silhouettes, NaN if there is nothing to compare. inside: (S, P) share
    of each part's worst cone that lies in the silhouettes, averaged over the cameras that show it,
    NaN if none does. explained: (S,) share of the surface voxels that the body explains, see
    `measure_explained`. clouds: the voxels.
    """

    rows: np.ndarray
    cameras: tuple[str, ...]
    body_iou: np.ndarray
    voxel_iou: np.ndarray
    inside: np.ndarray
    explained: np.ndarray
    clouds: tuple[VoxelCloud, ...]


def choose_rows(n_frames: int) -> np.ndarray:
    """Return evenly spaced rows of a track of `n_frames`, at most `MOST_FRAMES`."""
    return np.arange(0, n_frames, max(1, -(-n_frames // MOST_FRAMES)))


def compare_with_silhouettes(
    session: Session,
    grid: VoxelGrid,
    track: Track,
    progress: Callable[[], object] = lambda: None,
) -> Agreement:
    """Compare body and voxels in some frames of the track with the silhouettes that the voxels
    in `grid` were carved from, see `Session.iterate_carved`. progress: called after each frame."""
    rows, rig, body = choose_rows(len(track)), session.rig, track.its_body
    parts, drawn = find_parts(body), [i for i, cone in enumerate(body.cones) if cone.in_images]
    region, extents = volume_region(rig, grid), voxel_footprints(rig, grid.voxel_size)
    cones = posed_cones(body, track.poses[rows])
    indices = check_indices(session.sequence, track.frames[rows])

    def compare(pair: tuple[np.ndarray, CarvedFrame]) -> tuple[Any, ...]:
        posed, frame = pair
        shown, cloud = whole_silhouettes(frame.silhouettes, region), frame.cloud
        drawings, views = zip(*[
            _score_cones(camera, posed, drawn, silhouette, known)
            for camera, silhouette, known in zip(rig, shown, frame.known, strict=True)
        ], strict=True)  # fmt: skip
        scores, centres = np.array(views), cloud.centres
        means = dict(zip(drawn, np.ma.masked_invalid(scores[:, 1:]).mean(axis=0), strict=True))
        worst = [np.ma.min([means[cone] for cone in part.cones if cone in means]) for part in parts]
        return (
            scores[:, 0],
            score_voxels(rig, extents, centres, shown, frame.known),
            [np.nan if np.ma.is_masked(value) else float(value) for value in worst],
            measure_explained(rig, centres, posed, drawings, frame.known),
            cloud,
        )

    carved = zip(cones, session.iterate_carved(grid, indices), strict=True)
    compared = list[tuple[Any, ...]]()
    for found in map_in_threads(compare, carved):
        compared.append(found)
        progress()
    *figures, clouds = zip(*compared, strict=True)
    body_iou, voxel_iou, inside, explained = map(np.array, figures)
    return Agreement(rows, tuple(rig.names), body_iou, voxel_iou, inside, explained, clouds)


def _score_cones(
    camera: Camera,
    cones: np.ndarray,
    drawn: Items[int],
    silhouette: np.ndarray,
    known: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Draw posed cones (C, 16) in one camera, and score them at its `known` pixels (H, W) bool.

    Returns the pixels (H, W) bool that they cover, and scores (1 + n,): their IoU with the
    silhouette (H, W) bool, and for each `drawn` cone its share in the silhouette; NaN if too little
    of it is visible.
    """
    corners = np.rint(project_outlines(camera, cones))
    visible = np.flatnonzero(np.isfinite(corners).all((1, 2)))
    corners = corners[visible].astype(np.int32)
    low, high = np.clip([corners.min(1), corners.max(1) + 1], 0, camera.size).astype(np.int32)
    whole = np.zeros(silhouette.shape, bool)
    scores = np.full(1 + len(cones), np.nan)
    for cone, quad, first, end in zip(visible, corners, low, high, strict=True):
        box = np.s_[first[1] : end[1], first[0] : end[0]]
        shape = np.zeros(end[::-1] - first[::-1], np.uint8)
        if not shape.size:
            continue
        cv2.fillConvexPoly(shape, cv2.convexHull(quad) - first, 1)
        inside = shape.view(bool) & known[box]
        pixels = np.count_nonzero(inside)
        if pixels >= _LEAST_PIXELS:
            scores[1 + cone] = np.count_nonzero(inside & silhouette[box]) / pixels
        whole[box] |= inside
    scores[0] = iou(whole, silhouette)
    return whole, scores[[0, *(1 + cone for cone in drawn)]]


def measure_explained(
    rig: CameraRig,
    points: np.ndarray,
    cones: np.ndarray,
    drawings: Items[np.ndarray],
    known: np.ndarray,
) -> float:
    """Return the share of points (N, 3) m that posed cones (C, 16) explain; NaN without points.

    They explain what lies near them, and what they cover in most of the pictures that show it:
    between trunk and thigh of somebody who bends, the hull of few cameras is full. drawings: for
    each camera the pixels (H, W) bool that the body covers. known: (V, H, W) bool.
    """
    if not len(points):
        return np.nan
    far = points[cone_distances(points, cones).min(axis=1) > VOXEL_FAR]
    uncovered, shown = np.zeros(len(far), int), np.zeros(len(far), int)
    for camera, body, seen in zip(rig, drawings, known, strict=True):
        inside, y, x, _ = camera.look_up(far)
        shown[inside] += seen[y, x]
        uncovered[inside] += seen[y, x] & ~body[y, x]
    return float(1 - (2 * uncovered >= shown).sum() / len(points))


def measure_keypoint_agreement(track: Track, keypoints: Keypoints, rig: CameraRig) -> np.ndarray:
    """Return the share (F,) of the keypoints that lie near their point on the body; NaN in frames
    without keypoints.

    keypoints: of the cameras of `rig` and all frames of the sequence.
    """
    points = locate_points(track.its_body, keypoints.names)
    expected = points.place(track.its_body, track.poses).reshape(-1, 3)
    seen = undistort_points(rig, keypoints.points[:, track.frames][:, :, points.columns])
    off = reprojection_errors(rig, seen.reshape(len(rig), -1, 3), expected)
    depths = [(expected @ camera.R[2] + camera.t[2]) / camera.K[0, 0] for camera in rig]
    apart = (off * depths).reshape(seen.shape[:-1])
    sure = (np.nan_to_num(seen[..., 2]) >= TriangulationConfig().min_confidence) & ~np.isnan(apart)
    near = sure & (apart <= SAME_PLACE) & (apart >= 0)
    with np.errstate(invalid="ignore"):
        shares: np.ndarray = near.sum((0, 2)) / sure.sum((0, 2))
    return shares
