"""Estimate keypoints of a camera's video by a pose network, and write OpenPose's JSON files. Where
several people are, the network, which finds one person in a picture, gets the part of it in which
each stands."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import numpy as np

from apf.keypoints.network import PoseNetwork
from apf.keypoints.readers.orders import MEDIAPIPE
from cl import select_device
from psfs.backend import make_evidence_function
from psfs.cameras.camera import Camera
from psfs.common.files import write_text
from psfs.common.regions import keep_large_regions
from psfs.people.people import StandingPeople
from psfs.sequence import Frame, Sequence
from psfs.silhouettes.config import SilhouetteConfig
from psfs.voxels.config import DEBRIS_SHARE

_TRUNK = [MEDIAPIPE.index(n) for n in ("left_shoulder", "right_shoulder", "left_hip", "right_hip")]
#: Radius and height of the region about a person's axis, and height of the trunk, as shares
#: of the person's height.
_RADIUS, _ABOVE, _TRUNK_HEIGHT = 0.5, 1.25, 0.67
#: Distance from the trunk beyond which keypoints are somebody else's, as a share of the height.
_REACH = 0.25


class PersonFinder:
    """Detection of one of several people in one camera's video.

    The network sees the part of the picture in which the person is during the take, and follows
    the person. If it finds somebody else, it searches again in the region about the person's axis
    alone.
    """

    def __init__(
        self,
        network: PoseNetwork,
        camera: Camera,
        people: StandingPeople,
        person: int,
    ) -> None:
        self._network, self._camera, self._people = network, camera, people
        self._person = person
        self._follows = False
        regions = [self._find_region(position) for position in people.positions[:, person]]
        boxes = np.array([region for region in regions if region is not None]).reshape(-1, 4)
        self._crop = np.concatenate(
            [boxes[:, :2].min(0, initial=2**30), boxes[:, 2:].max(0, initial=0)]
        )

    def __call__(self, picture: np.ndarray, number: int) -> np.ndarray | None:
        """Return the keypoints (33, 3) px of the person in the picture (h, w, 3) of a frame, None
        if they are not found."""
        positions = self._people.find(number)
        region = self._find_region(positions[self._person])
        points = None
        if region is not None and self._follows:
            points = self._detect(picture, positions)
        if region is not None and points is None:
            self._network.forget()
            left, top, right, bottom = region
            alone = np.full_like(picture, round(picture.mean()))
            alone[top:bottom, left:right] = picture[top:bottom, left:right]
            points = self._detect(alone, positions)
        self._follows = points is not None
        return points

    def _detect(self, picture: np.ndarray, positions: np.ndarray) -> np.ndarray | None:
        """Return the keypoints in a picture, None if they are those of nobody, or of somebody else:
        far from the person's of `positions` (P, 3), or nearer to another's."""
        left, top, right, bottom = self._crop
        points = self._network(picture[top:bottom, left:right])
        if points is None:
            return None
        points = points + np.array([left, top, 0])
        trunks = positions * [1, 1, _TRUNK_HEIGHT]
        pixels, _ = self._camera.project(trunks)
        above, _ = self._camera.project(trunks + positions * [0, 0, 0.25])
        height = 4 * np.linalg.norm(above - pixels, axis=1)[self._person]
        away = np.linalg.norm(pixels - points[_TRUNK, :2].mean(0), axis=1)
        distances = away[self._person]
        return points if distances < _REACH * height and distances <= np.nanmin(away) else None

    def _find_region(self, position: np.ndarray) -> np.ndarray | None:
        """Return the region (4,) int, left, top, right, bottom px, about a position (3,): x, y and
        height of the top, m. None if that is unknown or not in the picture."""
        if not np.isfinite(position).all():
            return None
        angles = np.linspace(0, 2 * np.pi, 16, endpoint=False)
        ring = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1)
        heights = np.array([0, 0.5, 1]) * _ABOVE * position[2]
        points = np.array([*position[:2], 0]) + _RADIUS * position[2] * ring
        pixels, depths = self._camera.project(points + heights[:, None, None] * [0, 0, 1])
        if not (depths > 0).all():
            return None
        pixels = np.clip(pixels.reshape(-1, 2), 0, self._camera.size)
        low, high = np.floor(pixels.min(0)), np.ceil(pixels.max(0))
        return np.concatenate([low, high]).astype(int) if (high > low + 1).all() else None


#: Margin around the silhouette before the network sees it, least distance of it from the
#: crop's border, below which a new crop is made, and size of a crop that is too large, as shares of
#: the silhouette's larger side.
_MARGIN, _SLACK, _LARGEST = 0.5, 0.1, 4.0


def estimate_camera(
    progress: Callable[[str], object],
    folder: Path,
    stated: Mapping[str, Any],
    n_frames: int,
    device: str | None,
    people: StandingPeople | None,
) -> np.ndarray:
    """Return one camera's keypoints (P, F, 33, 3) px of P people, NaN where a person was not found.

    A process estimates those of one camera. progress: called after each frame. stated: overrides of
    `Sequence.open`, with the camera. device: name, for the silhouettes that pictures are cropped
    by; None for whole pictures. people: where several people stand, all of them are detected; None
    for one person. Raises InputError.
    """
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # the network's libraries tell users nothing
    sequence = Sequence.open(folder, **stated)
    n_people = 1 if people is None else people.positions.shape[1]
    points = np.full((n_people, n_frames, len(MEDIAPIPE), 3), np.nan)
    with ExitStack() as stack:
        networks = [stack.enter_context(closing(PoseNetwork())) for _ in range(n_people)]
        alone = CroppedFinder(networks[0], sequence, device) if people is None else None
        finders = [] if people is None else [
            PersonFinder(network, sequence.rig[0], people, k) for k, network in enumerate(networks)
        ]  # fmt: skip
        for frame in sequence.frames(slice(n_frames)):
            (picture,) = sequence.rig.crop(frame.images)
            persons = [find(picture, frame.index) for find in finders]
            persons += [alone(frame)] if alone is not None else []
            for row, person in zip(points, persons, strict=True):
                if person is not None:
                    row[frame.index] = person
            progress("keypoints")
    return points


def write_openpose(folder: Path, camera: str, points: np.ndarray) -> None:
    """Write one camera's keypoints (P, F, K, 3) of P people in OpenPose's format.

    Each file, `<camera>_<frame:06d>.json`, has the people with at least one known point.
    Raises InputError.
    """
    for frame, persons in enumerate(points.swapaxes(0, 1)):
        people = [
            {
                "person_id": [-1],
                "pose_keypoints_2d": np.round(np.nan_to_num(person), 3).ravel().tolist(),
            }
            for person in persons
            if np.isfinite(person).any()
        ]
        path, content = folder / f"{camera}_{frame:06d}.json", {"version": 1.3, "people": people}
        write_text(path, json.dumps(content))


class CroppedFinder:
    """Detection of the only person in one camera's frames: in the crop around the silhouette, if a
    `device` for it is named, or else in the whole picture."""

    def __init__(self, network: PoseNetwork, sequence: Sequence, device: str | None) -> None:
        self._network, self._rig = network, sequence.rig
        self._box: np.ndarray | None = None
        self._evidence: Callable[[Frame], np.ndarray] | None = None
        if device is not None:
            self._evidence = make_evidence_function(
                select_device(device), sequence.rig, sequence.background, SilhouetteConfig()
            )

    def __call__(self, frame: Frame) -> np.ndarray | None:
        """Return the keypoints (33, 3) px of the whole picture; None if nobody is found."""
        before, (picture,) = self._box, self._rig.crop(frame.images)
        if self._evidence is not None:
            self._box = update_crop(self._rig.crop(self._evidence(frame))[0] > 0, before)
        if self._box is not before:
            self._network.forget()
        if self._box is not None:
            left, top, right, bottom = self._box
            points = self._network(picture[top:bottom, left:right])
            if points is not None:
                return points + np.array([left, top, 0])
            self._network.forget()
        return self._network(picture)


def update_crop(silhouette: np.ndarray, before: np.ndarray | None) -> np.ndarray | None:
    """Return the crop (4,) int, left, top, right, bottom px, for a silhouette (h, w) bool.

    before: the last crop, kept while the person fits into it. None, the whole picture, for an empty
    silhouette.
    """
    rows, columns = np.nonzero(keep_large_regions(silhouette, DEBRIS_SHARE))
    if not rows.size:
        return None
    low = np.array([columns.min(), rows.min()])
    high = np.array([columns.max(), rows.max()]) + 1
    side = (high - low).max()
    size = np.array(silhouette.shape[::-1])
    if before is not None:
        slack = _SLACK * side
        # At the picture's border no margin is possible.
        fits = (before[:2] <= np.maximum(low - slack, 0)).all()
        fits &= (before[2:] >= np.minimum(high + slack, size)).all()
        if fits and (before[2:] - before[:2]).max() <= _LARGEST * side:
            return before
    margin = _MARGIN * side
    corners = np.concatenate([np.maximum(low - margin, 0), np.minimum(high + margin, size)])
    return corners.astype(int)
