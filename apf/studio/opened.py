"""A track that is opened for watching, with its footage if that exists."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from apf.report.drawing import Figure, draw_mosaic
from apf.report.summary import SUMMARY, read_summary, read_tracked_config, read_tracked_grid
from apf.tracking.people import PeopleTracks, holds_people, list_people
from apf.tracking.track import Track
from cl import Device, InputError, NumpyDevice, UserError
from psfs.common.files import name_file_in_errors
from psfs.output.reconstruction_folder import reopen_sequence
from psfs.page.clouds import CarvedClouds, Opened, try_footage
from psfs.page.nodes import box_around
from psfs.sequence import Frame, Sequence
from psfs.session import Session, SessionSettings
from psfs.voxels.config import ReconstructionConfig
from psfs.voxels.grid import VoxelCloud, VoxelGrid

#: Makes the device that voxels are carved on, when they are first needed.
MakeDevice = Callable[[], Device | NumpyDevice]


@dataclass(frozen=True, eq=False)
class OpenedTracks(Opened):
    """A run whose bodies are watched.

    figures: each person as drawn, by the name of the person's folder; one at least. people: number
    of people in the take. quality: the lines of the judgement. look_at: frames (n,) to check, by
    what is doubtful there.
    """

    figures: Mapping[str, Figure] = field(default_factory=dict)
    people: int = 1
    quality: tuple[str, ...] = ()
    look_at: Mapping[str, np.ndarray] = field(default_factory=dict)

    @cached_property
    def tracks(self) -> dict[str, Track]:
        """The track of each person."""
        return {name: figure.track for name, figure in self.figures.items()}

    def draw(self, frame: Frame, view: int | None) -> np.ndarray:
        """Return the picture (h, w, 3) uint8 BGR of a frame with all bodies; of one camera (its
        index) or, for None, of all."""
        assert self.sequence is not None
        views = None if view is None else [view]
        return draw_mosaic(frame, self.sequence.rig, list(self.figures.values()), views)

    @property
    def track(self) -> Track:
        """The track of the only person, or of the first one."""
        return next(iter(self.tracks.values()))


@dataclass(frozen=True, eq=False)
class RunningTake:
    """The input of a run that goes on: its footage, and the settings of its voxels."""

    sequence: Sequence
    config: ReconstructionConfig


def read_figures(folder: Path) -> dict[str, Figure]:
    """Return each person of a folder of tracks as drawn, in the frames that show the person, by the
    name of the person's folder. Raises InputError, also if no frame was tracked."""
    folders = list_people(folder) or [folder]
    people = PeopleTracks.open(folder) if holds_people(folder) else None
    tracks = people or [Track.open(each) for each in folders]
    present = [None] * len(folders) if people is None else people.seen  # before all are tracked
    if not any(map(len, tracks)):
        raise InputError(f"{folder}: holds no tracked frame; expected at least one")
    figures = {}
    for number, (subfolder, track, frames) in enumerate(zip(folders, tracks, present, strict=True)):
        with name_file_in_errors(subfolder):
            _ = track.its_body if track.dof_names else None
        who = number if len(folders) > 1 else None
        figures[subfolder.name] = Figure(track, subfolder.name, who, frames)
    return figures


def open_track(
    folder: Path,
    make_device: MakeDevice,
    known: Callable[[int], object] = lambda frame: None,
    running: RunningTake | None = None,
) -> OpenedTracks:
    """Open a folder that `apf track` wrote, or still writes; that of all people if there are
    several. known: called with the number of each frame after its voxels are carved. running:
    what a run reads that goes on, and has not written that yet. Raises InputError, or
    MissingFileError."""
    folders, figures = list_people(folder) or [folder], read_figures(folder)
    tracks = [figure.track for figure in figures.values()]
    frames = np.unique(np.concatenate([track.frames for track in tracks]))
    for track in tracks:
        _ = track.its_body  # raises InputError
    remarks: list[str] = []
    try:
        summaries = [read_summary(each) for each in folders]
        remarks += summaries[0]["warnings"]
        facts, file = summaries[0]["sequence"], folders[0] / SUMMARY
        sequence = try_footage(lambda: reopen_sequence(facts, file, int(frames[-1])), remarks)
        running = None
    except UserError as error:  # of a run that goes on, or was killed
        summaries, sequence = [], running.sequence if running is not None else None
        goes_on = "the run goes on; `voxels` shows them, and slows it down"
        remarks.append(str(error) if running is None else goes_on)
    clouds, grid = None, _joint_grid(tracks)
    if sequence is not None and grid is not None:

        def carve() -> Iterator[tuple[int, VoxelCloud]]:
            config = running.config if running else read_tracked_config(folders[0], summaries[0])
            session = Session(sequence, make_device(), SessionSettings(config))
            with closing(session.iterate_carved(grid, frames.tolist())) as carved:  # type: ignore[type-var]
                for frame in carved:
                    yield frame.index, frame.cloud

        clouds = CarvedClouds(grid, len(frames), carve, known)
    joints = [track.joints.reshape(-1, 3) for track in tracks]
    voxels = None if clouds is None else clouds.grid
    box = (voxels.low, voxels.high) if voxels else box_around(np.concatenate(joints))
    quality, look_at = _gather_judgements(list(figures), summaries)
    people = summaries[0].get("people", 1) if summaries else len(tracks)
    return OpenedTracks(
        folder, frames, tracks[0].fps, box, sequence, clouds, tuple(remarks), running is None,
        figures, people, quality, look_at,
    )  # fmt: skip


def _gather_judgements(
    names: list[str], summaries: list[dict[str, Any]]
) -> tuple[tuple[str, ...], dict[str, np.ndarray]]:
    """Return the lines of each person's judgement, and the frames to check by what is doubtful
    there; of several people with their names."""
    lines: list[str] = []
    look_at: dict[str, np.ndarray] = {}
    for name, summary in zip(names, summaries, strict=False):  # none of a run that goes on
        whose = f"{name}: " if len(names) > 1 else ""
        lines += [f"{whose}{line}" for line in summary.get("says", ())]
        for what, ranges in summary.get("quality", {}).get("look_at", {}).items():
            if ranges:
                frames = [np.arange(low, high + 1) for low, high in ranges]
                look_at[f"{whose}{what}"] = np.concatenate(frames)
    return tuple(lines), look_at


def _joint_grid(tracks: Iterable[Track]) -> VoxelGrid | None:
    """Return the grid that covers those of all tracks, in the first one's voxels; None without
    voxels."""
    grids = [grid for track in tracks if (grid := read_tracked_grid(track)) is not None]
    if len(grids) < 2:
        return grids[0] if grids else None
    low, high = np.min([g.low for g in grids], axis=0), np.max([g.high for g in grids], axis=0)
    return VoxelGrid.covering(low, high, grids[0].voxel_size)
