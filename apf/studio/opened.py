"""A run that is opened for watching: a track, or voxels, with its footage if that exists."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from apf.report.summary import (
    open_tracked_sequence,
    read_summary,
    read_tracked_config,
    read_tracked_grid,
)
from apf.studio.clouds import CarvedClouds, Clouds, StoredClouds
from apf.studio.folders import list_people
from apf.tracking.track import Track
from cl import Device, InputError, NumpyDevice, UserError
from psfs.output.reconstruction_folder import ReconstructionFolder
from psfs.sequence import Sequence
from psfs.session import Session, SessionSettings
from psfs.voxels.grid import VoxelCloud, VoxelGrid

#: Makes the device that voxels are carved on, when they are first needed.
MakeDevice = Callable[[], Device | NumpyDevice]


@dataclass(frozen=True, eq=False)
class Opened:
    """A run that is watched.

    frames: (F,) numbers, ascending. tracks: one per person, by the name of the person's folder.
    sequence: the footage; None if it is gone. remarks: warnings, for the page. quality: the lines
    of its judgement. look_at: frames (n,) to check, by what is doubtful there.
    """

    folder: Path
    frames: np.ndarray
    fps: float
    tracks: Mapping[str, Track]
    sequence: Sequence | None
    clouds: Clouds | None = None
    remarks: tuple[str, ...] = ()
    quality: tuple[str, ...] = ()
    look_at: Mapping[str, np.ndarray] = field(default_factory=dict)

    @cached_property
    def rows(self) -> dict[str, dict[int, int]]:
        """Row of each frame's number in each track."""
        return {
            name: {int(frame): row for row, frame in enumerate(track.frames)}
            for name, track in self.tracks.items()
        }

    @property
    def track(self) -> Track | None:
        """The track of the only person, or of the first one."""
        return next(iter(self.tracks.values()), None)

    def close(self) -> None:
        """End all work in the background."""
        if self.clouds is not None:
            self.clouds.close()


def open_voxels(folder: Path) -> Opened:
    """Open a run of `psfs reconstruct`. Raises InputError, or MissingFileError."""
    run = ReconstructionFolder.open(folder)
    remarks: list[str] = []
    run.warn_if_unfinished(remarks.append)
    if not run.indices:
        raise InputError(f"{folder}: holds no reconstructed frame; expected at least one")
    sequence = _try_footage(run.sequence, remarks)
    fps = float(run.summary["sequence"].get("fps") or 25.0)
    clouds = StoredClouds(run)
    frames = np.array(run.indices)
    return Opened(folder, frames, fps, {}, sequence, clouds, tuple(remarks))


def open_track(
    folder: Path, make_device: MakeDevice, known: Callable[[int], object] = lambda frame: None
) -> Opened:
    """Open a folder that `apf track` wrote, or still writes; that of all people if there are
    several. known: called with the number of each frame after its voxels are carved. Raises
    InputError, or MissingFileError."""
    tracks = _read_tracks(folder)
    first = next(iter(tracks.values()))
    frames = np.unique(np.concatenate([track.frames for track in tracks.values()]))
    if not len(frames):
        raise InputError(f"{folder}: holds no tracked frame; expected at least one")
    for track in tracks.values():
        _ = track.its_body  # raises InputError
    remarks: list[str] = []
    try:
        summary = read_summary(folder if len(tracks) == 1 else folder / next(iter(tracks)))
    except UserError as error:  # of a run that goes on, or was killed
        return Opened(folder, frames, first.fps, tracks, None, remarks=(str(error),))
    remarks += summary["warnings"]
    sequence = _try_footage(
        lambda: open_tracked_sequence(folder, summary, int(frames[-1])), remarks
    )
    clouds = None
    grid = _joint_grid(tracks)
    if sequence is not None and grid is not None:
        clouds = CarvedClouds(
            grid, len(frames), _carver(folder, summary, sequence, grid, make_device, frames), known
        )
    found = summary.get("quality", {}).get("look_at", {})
    look_at = {
        what: np.concatenate([np.arange(a, b + 1) for a, b in ranges])
        for what, ranges in found.items()
        if ranges
    }
    quality = tuple(summary.get("says", ()))
    return Opened(
        folder, frames, first.fps, tracks, sequence, clouds, tuple(remarks), quality, look_at
    )


def _read_tracks(folder: Path) -> dict[str, Track]:
    """Return the tracks of all people in a folder by name."""
    people = list_people(folder)
    if people:
        return {path.name: Track.open(path) for path in people}
    return {folder.name: Track.open(folder)}


def _joint_grid(tracks: Mapping[str, Track]) -> VoxelGrid | None:
    """Return the grid that covers those of all tracks, in the first one's voxels; None without
    voxels."""
    grids = [grid for track in tracks.values() if (grid := read_tracked_grid(track)) is not None]
    if len(grids) < 2:
        return grids[0] if grids else None
    low, high = np.min([g.low for g in grids], axis=0), np.max([g.high for g in grids], axis=0)
    return VoxelGrid.covering(low, high, grids[0].voxel_size)


def _carver(
    folder: Path,
    summary: Mapping[str, Any],
    sequence: Sequence,
    grid: VoxelGrid,
    make_device: MakeDevice,
    frames: np.ndarray,
) -> Callable[[], Iterator[tuple[int, VoxelCloud]]]:
    """Return a function that carves the frames (F,) again, with the settings of the track."""

    def carve() -> Iterator[tuple[int, VoxelCloud]]:
        settings = SessionSettings(read_tracked_config(folder, dict(summary)))
        session = Session(sequence, make_device(), settings)
        with closing(session.iterate_carved(grid, frames.tolist())) as carved:  # type: ignore[type-var]
            for frame in carved:
                yield frame.index, frame.cloud

    return carve


def _try_footage(open_footage: Callable[[], Sequence], remarks: list[str]) -> Sequence | None:
    """Return the footage, or add a remark why there is none."""
    try:
        return open_footage()
    except UserError as error:
        remarks.append(f"no pictures: {error}")
        return None
