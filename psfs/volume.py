"""The stage `volume`: the box to reconstruct and its grid, from the rig and some silhouettes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cl import InputError
from psfs.cameras.camera import CameraRig
from psfs.common.numbers import pick_evenly
from psfs.sequence import Sequence
from psfs.session import Session, check_frames
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.occupied_box import (
    FLOOR,
    default_voxel_size,
    largest_parts_box,
    reachable_box,
    remove_speckle,
)

#: Examined frames, spread over the selection.
VOLUME_SAMPLES = 8
#: Margin on each side of the box, as a share of the box.
VOLUME_MARGIN = 0.06
#: Voxels along the longest side of the volume in the coarse search, and the least margin in them.
_COARSE, _MARGIN_VOXELS = 64, 1.5
#: Height, m, to which people's heads reach.
_HEIGHT = 2.0
#: Depth, m, below FLOOR beyond which visible parts count nevertheless: people reach 0.1 m.
_FLOOR_DEPTH = 0.25


@dataclass(frozen=True, eq=False)
class Volume:
    """The box to reconstruct: its lowest and highest corner (3,), m."""

    low: np.ndarray
    high: np.ndarray


def automatic_grid(session: Session) -> VoxelGrid:
    """Return the grid of the session's volume, see `find_volume`.

    Voxels are as large as the session's settings state; by default 2 cm for people and 1/150 of
    the longest side for smaller scenes. Raises InputError as `find_volume` does.
    """

    def compute() -> VoxelGrid:
        volume = find_volume(session)
        voxel_size = session.settings.voxel_size
        if voxel_size is None:
            objects = session.sequence.subject == "object"
            voxel_size = default_voxel_size(session.rig, volume.low, volume.high, objects=objects)
        return VoxelGrid.covering(volume.low, volume.high, voxel_size)

    return session.compute_once(automatic_grid, compute)


def find_volume(session: Session) -> Volume:
    """Return the volume that the sequence states, or a box around everything that moves in the
    selected frames.

    Without a stated volume, the scene within reach of the cameras is reconstructed coarsely in some
    frames spread over the selection. The volume is the box around the largest connected part of
    each of these frames, with a margin. If the subject is a person, and no part is below the floor,
    it reaches from there to people's height. Raises InputError if no frame shows foreground.
    """
    return session.compute_once(find_volume, lambda: _find_box(session))


def _find_box(session: Session) -> Volume:
    stated = session.sequence.volume
    if stated is not None:
        return Volume(np.asarray(stated[0], np.float64), np.asarray(stated[1], np.float64))
    frames = check_frames(session)
    config = session.reconstruction
    picked = pick_evenly(len(frames), VOLUME_SAMPLES)
    evidence = session.evidence([frames[int(i)] for i in picked])
    search = BoxSearch(
        session.rig,
        [remove_speckle(maps) for maps in evidence],
        config.occupancy.seeing_cameras(len(session.rig)),
        has_floor=session.sequence.subject != "object",
    )
    box = search.run()
    if box is None:
        raise InputError(
            f"{session.sequence.folder}: nothing stands out from the background in "
            f"{len(picked)} of the selected frames; expected "
            f"{describe_expected_person(session.sequence)}"
        )
    return Volume(*box)


Box = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class BoxSearch:
    """Search for the box around the largest part of each frame, coarse to fine. evidence: maps of
    each frame, from `remove_speckle`. min_cameras: least number of cameras that see an occupied
    voxel. has_floor: whether a floor is assumed, if the rig is large enough for people."""

    rig: CameraRig
    evidence: list[np.ndarray]
    min_cameras: int
    has_floor: bool = True

    def run(self) -> Box | None:
        """Return the lowest and highest corner, m; None if nothing is occupied."""
        everywhere = reachable_box(self.rig, floor=False)
        above = reachable_box(self.rig, floor=self.has_floor)
        has_floor = above[0][2] > everywhere[0][2]
        lowest = FLOOR - _FLOOR_DEPTH if has_floor else np.inf
        box = self._within(everywhere)
        if box is not None and box[0][2] <= lowest:  # else `above`, smaller, gives the same
            box = self._within(box)  # finer voxels resolve parts smaller than coarse ones
        if box is None or box[0][2] <= lowest:
            return box
        box = self._within(above)
        box = box and self._within(box)
        return box and _stand_on_floor(box, float(above[1][2]))

    def _within(self, box: Box) -> Box | None:
        """Return the box around the occupied voxels in `box`, with a margin."""
        low, high = box
        grid = VoxelGrid.covering(low, high, float(np.max(high - low)) / _COARSE)
        found = largest_parts_box(self.rig, self.evidence, grid, self.min_cameras)
        if found is None:
            return None
        margin = np.maximum(VOLUME_MARGIN * (found[1] - found[0]), _MARGIN_VOXELS * grid.voxel_size)
        return np.maximum(found[0] - margin, low), np.minimum(found[1] + margin, high)


def _stand_on_floor(box: Box, most: float) -> Box:
    """Return the box, m, down to the floor and as high as people are, at most to the height `most`:
    feet or head may be hidden, or look like the background, in the frames that were examined."""
    low, high = box[0].copy(), box[1].copy()
    low[2], high[2] = FLOOR, max(high[2], min(_HEIGHT, most))
    return low, high


def describe_expected_person(sequence: Sequence) -> str:
    """Return the advice for an error message, if nothing stands out from the background."""
    if sequence.background_kind == "masks":
        some = sequence.select_frames(pick_evenly(len(sequence), 10).tolist())
        brightest = max((int(f.masks.max()) for f in some if f.masks is not None), default=0)
        return f"masks that are 255 where the person is (the greatest value in them is {brightest})"
    if sequence.empty_scene:
        return "a person in view of the cameras"
    return (
        "a person who moves, since the background is estimated from the frames themselves, or "
        "pictures of the empty scene in background/"
    )
