"""Facts of a sequence and warnings of likely errors, for `psfs info`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import (
    SAME_PLACE,
    find_seen_box,
    find_seen_points,
    intersect_axes,
    required_cameras,
    required_views,
)
from psfs.sequence import Sequence

#: The end of the warnings of a rig's size.
UNIT_ASKED = "State the `unit`"
#: Range of a rig's size, m, around people or objects; a size outside hints at a wrong unit.
PLAUSIBLE_EXTENT = (0.05, 100.0)
#: Names of keypoints: ours, Pose2Sim's, OpenPose's, FreeMoCap's, OpenCap's, DeepLabCut's.
_KEYPOINTS = (
    "keypoints.npz", "pose", "pose-2d", "openpose*", "*_json", "keypoints",
    "output_data/raw_data/*2dData*pixelXY.npy", "Videos/Cam*/OutputPkl*", "*DLC_*.csv",
    "*DLC_*.h5",
)  # fmt: skip


class SequenceInfo:
    """What follows from a sequence's files. Decodes no more than opening the sequence did.

    centre: (3,) m, where the optical axes meet; distances: (V,) m of the cameras from there.
    shared: box (low, high), m, that `needed` cameras see, or None. extent: m between the rig's
    farthest cameras. warnings: likely errors. keypoints: file or folder that seems to hold 2-D
    keypoints of a pose network, or None; nothing here reads it.
    """

    def __init__(self, sequence: Sequence) -> None:
        rig = sequence.rig
        self.centre, self.needed = intersect_axes(rig), required_views(rig)
        self.distances = np.linalg.norm(rig.centres - self.centre, axis=1)
        self.shared = find_seen_box(rig, self.needed)
        self.extent = rig_extent(rig)
        self.warnings = [*_count_warnings(sequence), *rig_warnings(rig)]
        self.keypoints = find_keypoints(sequence.folder)


def find_keypoints(folder: Path) -> Path | None:
    """Return the file or folder in `folder` whose name says that it holds 2-D keypoints, if there
    is one."""
    matches = (path for pattern in _KEYPOINTS for path in sorted(folder.glob(pattern)))
    return next(matches, None)


def rig_extent(rig: CameraRig) -> float:
    """Return the largest distance between two cameras, m; for a single camera its distance to the
    origin."""
    centres = rig.centres
    if len(rig) == 1:
        return float(np.linalg.norm(centres[0]))
    return float(np.linalg.norm(centres[:, None] - centres[None], axis=-1).max())


def rig_warnings(rig: CameraRig) -> list[str]:
    """Return warnings of likely errors of a rig that is taken to be in metres with Z up."""
    warnings = []
    extent = rig_extent(rig)
    low, high = PLAUSIBLE_EXTENT
    if len(rig) > 1 and extent < SAME_PLACE:
        warnings.append("all cameras stand at one place; expected them around what is filmed")
    elif not low <= extent <= high:
        large = "millimetres" if extent > 10 * high else "centimetres"
        guess = f"{large} read as metres" if extent > high else "metres read as millimetres"
        warnings.append(f"the rig is {extent:.3g} m across; {guess}? {UNIT_ASKED}")
    below = [camera.name for camera in rig if camera.centre[2] < 0]
    if len(below) == len(rig):
        warnings.append("all cameras lie below z = 0; is the up axis right? State it as `up`")
    elif len(rig) > 1 and not _stands(rig):
        warnings.append(
            "the cameras stand neither upright, nor on their sides, nor look down; is the up axis "
            "right? State it as `up`"
        )
    return warnings + _blind_warnings(rig)


def _stands(rig: CameraRig) -> bool:
    """Return whether most cameras stand upright, all lie on their sides, or all look down."""
    z = np.stack([camera.R[:, 2] for camera in rig])  # the vertical in each camera's axes
    aside, down = (np.abs(z[:, 0]) > 0.7).all(), (z[:, 2] < -0.3).all()
    return bool((-z[:, 1] > 0.5).mean() > 0.5 or aside or down)


def _blind_warnings(rig: CameraRig) -> list[str]:
    """Return warnings of cameras that see nothing of the box that most others see."""
    if len(rig) == 1:
        return []
    points = find_seen_points(rig, 1)
    seen = np.stack([camera.look_up(points)[0] for camera in rig])
    shared = seen.sum(axis=0) - seen >= required_cameras(len(rig) - 1, 0.75)
    blind = shared.any(axis=1) & ~(shared & seen).any(axis=1)
    warnings = [
        f"camera {rig.names[view]} sees nothing of the volume the others share"
        for view in np.flatnonzero(blind)
    ]
    if not (seen.sum(axis=0) > 1).any():
        warnings.append("no point is seen by two cameras")
    return warnings


def _count_warnings(sequence: Sequence) -> list[str]:
    warnings = []
    for what in ("images", "masks"):
        media = getattr(sequence.footage, what) or ()
        counts = {item.name: item.count for item in media}
        if len(set(counts.values())) > 1:
            listed = ", ".join(f"{name} {count}" for name, count in counts.items())
            warnings.append(
                f"unequal numbers of {what}: {listed}; the first {len(sequence)} are used"
            )
    images, masks = sequence.footage.images, sequence.footage.masks
    if images and masks and min(m.count for m in images) != min(m.count for m in masks):
        warnings.append("there are not as many masks as images; the shorter of both is used")
    return warnings
