"""The output folder of `psfs reconstruct`: its contents, and opening it again."""

from __future__ import annotations

import os.path
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AliasChoices, Field

from cl import Device, InputError, MissingFileError, NumpyDevice
from psfs.cameras.names import join_names
from psfs.common.files import name_file_in_errors, read_json
from psfs.common.outputs import find_unfinished_command
from psfs.common.schema import (
    AbsolutePath,
    Name,
    Number,
    PathText,
    Positive,
    Table,
    Vector,
    parse_values,
)
from psfs.sequence import Sequence
from psfs.voxels.clouds import read_cloud
from psfs.voxels.config import ReconstructionConfig
from psfs.voxels.grid import VoxelCloud, VoxelGrid, check_size

SUMMARY = "summary.json"
#: Patterns of the names that `cloud_stem` makes.
CLOUDS = tuple(f"clouds/frame_{6 * '[0-9]'}.{suffix}" for suffix in ("ply", "npz"))


def cloud_stem(out: Path, index: int) -> Path:
    """Return the path of frame `index`'s cloud without suffix."""
    return out / "clouds" / f"frame_{index:06d}"


def sequence_facts(
    sequence: Sequence, out: Path, overrides: Mapping[str, Any], left_out: Mapping[str, str]
) -> dict[str, Any]:
    """Describe a sequence for the summary in `out`, so that it can be opened again.

    overrides: arguments of `Sequence.open`. left_out: names of excluded cameras, with the reasons.
    """
    folder = os.path.realpath(sequence.folder)
    return {
        "folder": str(sequence.folder),
        "absolute": folder,
        **_find_relative(folder, out),
        "overrides": dict(overrides),
        "cameras": sequence.rig.names,
        "left_out": dict(left_out),
        "background": sequence.background_kind,
        "fps": sequence.fps,
    }


def _find_relative(folder: str, out: Path) -> dict[str, str]:
    """Return the sequence's folder seen from `out`; nothing where they lie on two drives."""
    try:
        return {"relative": os.path.relpath(folder, os.path.realpath(out))}
    except ValueError:
        return {}


def reopen_sequence(facts: Mapping[str, Any], file: Path, last: int) -> Sequence:
    """Open the sequence of `sequence_facts` again.

    file: the one that holds the facts. last: a frame that must exist. Raises MissingFileError if
    the folder is gone, InputError if it holds another sequence.
    """
    folders = [Path(facts["absolute"])]
    if "relative" in facts:  # where both were moved or copied together
        folders.append(file.parent / facts["relative"])
    folder = next((folder for folder in folders if folder.is_dir()), None)
    if folder is None:
        raise MissingFileError(
            f"{file}: its sequence {facts['absolute']} is gone; expected a folder"
        )
    with name_file_in_errors(file):
        sequence = Sequence.open(folder, **facts["overrides"])
    names = facts.get("cameras", sequence.rig.names)
    if sequence.rig.names != names or last >= len(sequence):
        raise InputError(
            f"{file}: made of {last + 1} or more frames of {join_names(names)}; {folder} now has "
            f"{len(sequence)} of {join_names(sequence.rig.names)}; expected the same sequence"
        )
    return sequence


def device_facts(device: Device | NumpyDevice) -> dict[str, Any]:
    return dict(vars(device.info)) if isinstance(device, Device) else {"name": device.name}


def grid_facts(grid: VoxelGrid) -> dict[str, Any]:
    return {
        "origin_m": grid.origin.tolist(),
        "high_m": grid.high.tolist(),
        "voxel_size_m": grid.voxel_size,
        "shape": list(grid.shape),
    }


class SequenceFacts(Table):
    """The entries of `sequence_facts` that are read."""

    absolute: AbsolutePath
    overrides: dict[str, Any]
    relative: PathText = ""
    cameras: list[Name] | None = None
    left_out: dict[str, str] | None = None


class GridFacts(Table):
    """The entries of `grid_facts` that are read; a track's provenance names no units."""

    origin: Vector = Field(validation_alias=AliasChoices("origin_m", "origin"))
    voxel_size: Positive = Field(validation_alias=AliasChoices("voxel_size_m", "voxel_size"))
    shape: Annotated[list[Annotated[int, Field(ge=1, le=2**20)]], Field(min_length=3, max_length=3)]

    @property
    def grid(self) -> VoxelGrid:
        """The grid. Raises InputError if it is too large."""
        nx, ny, nz = self.shape
        grid = VoxelGrid(np.array(self.origin), self.voxel_size, (nx, ny, nz))
        check_size(grid)
        return grid


class _FrameFacts(Table):
    index: Annotated[int, Field(ge=0, le=2**40)]
    surface_voxels: Annotated[int, Field(ge=0, le=2**40)]
    volume_m3: Number


class _Summary(Table):
    """The entries of a summary that are read."""

    sequence: SequenceFacts
    grid: GridFacts
    config: dict[str, Any]
    frames: list[_FrameFacts]
    complete: bool = True


@dataclass(frozen=True)
class ReconstructionFolder:
    """A finished (or interrupted) `psfs reconstruct`."""

    out: Path
    summary: dict[str, Any]

    @classmethod
    def open(cls, out: Path) -> ReconstructionFolder:
        """Read the summary in `out`. Raises InputError, or MissingFileError, if it holds no run."""
        path, what = out / SUMMARY, "the summary of a `psfs reconstruct`"
        summary = read_json(path, what)
        try:
            parse_values(_Summary, summary)
            run = cls(out, summary)
            _ = run.grid  # raises InputError
        except InputError as error:
            raise InputError(f"{path}: not {what}: {error}") from None
        steps = np.diff(run.indices)
        if np.any(steps <= 0) or np.unique(steps).size > 1:
            raise InputError(f"{path}: not {what}: its frames are not evenly spaced")
        return run

    @property
    def inputs(self) -> list[Path]:
        """The folders that the run was made from, and its own."""
        return [self.out, Path(self.summary["sequence"]["absolute"])]

    def warn_if_unfinished(self, warn: Callable[[str], object]) -> None:
        """Warn if the run did not finish."""
        n = len(self.indices)
        if find_unfinished_command(self.out) is not None or not self.summary.get("complete", True):
            warn(f"{self.out}: the run did not finish; it holds {n} frames")

    @property
    def indices(self) -> list[int]:
        """Indices of the reconstructed frames."""
        return [int(frame["index"]) for frame in self.summary["frames"]]

    def choose_frame(self, number: int | None) -> int:
        """Return the frame `number`, by default the first that is not empty.

        Raises InputError if it was not reconstructed.
        """
        if not self.indices:
            raise InputError(f"{self.out}: holds no reconstructed frame; expected at least one")
        if number is None:
            frames = self.summary["frames"]
            full = [int(frame["index"]) for frame in frames if frame["surface_voxels"]]
            return [*full, self.indices[0]][0]
        if number not in self.indices:
            first, last = self.indices[0], self.indices[-1]
            raise InputError(f"{self.out}: no frame {number}; it holds frames {first} to {last}")
        return number

    @property
    def config(self) -> ReconstructionConfig:
        """The parameters of the run. Raises InputError if they are those of another version."""
        config = self.summary["config"]
        try:
            return ReconstructionConfig.from_dict(config)
        except InputError as error:
            raise InputError(
                f"{self.out / SUMMARY}: not the parameters that this version knows ({error}); "
                "run psfs reconstruct again"
            ) from error

    @property
    def grid(self) -> VoxelGrid:
        return parse_values(GridFacts, self.summary["grid"]).grid

    def cloud(self, index: int) -> VoxelCloud:
        """Read a frame's cloud. Raises InputError, also if its grid is another one."""
        path = cloud_stem(self.out, index).with_suffix(".npz")
        cloud = read_cloud(path)
        if grid_facts(cloud.grid) != grid_facts(self.grid):
            raise InputError(
                f"{path}: its grid is not that of {SUMMARY}; expected the clouds of one run"
            )
        return cloud

    def sequence(self) -> Sequence:
        """Open the sequence again. Raises as `reopen_sequence` does."""
        last = self.indices[-1] if self.indices else -1
        return reopen_sequence(self.summary["sequence"], self.out / SUMMARY, last)
