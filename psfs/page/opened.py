"""What a page shows: a run's voxels over time, with its footage if that exists."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from cl import InputError, UserError
from psfs.output.reconstruction_folder import ReconstructionFolder
from psfs.page.clouds import Clouds, StoredClouds
from psfs.sequence import Sequence
from psfs.voxels.grid import VoxelGrid


@dataclass(frozen=True, eq=False)
class Opened:
    """A run that is watched.

    frames: (F,) numbers, ascending. sequence: the footage; None if it is gone. remarks: warnings,
    for the page.
    """

    folder: Path
    frames: np.ndarray
    fps: float
    sequence: Sequence | None
    clouds: Clouds | None
    remarks: tuple[str, ...] = ()
    voxels_shown: bool = True
    """Whether voxels are shown before the user chooses."""

    @property
    def grid(self) -> VoxelGrid:
        """The voxels' grid, which the floor lies under."""
        assert self.clouds is not None
        return self.clouds.grid

    def close(self) -> None:
        """End all work in the background."""
        if self.clouds is not None:
            self.clouds.close()


def open_voxels(folder: Path, mesher: Callable[[int], trimesh.Trimesh] | None = None) -> Opened:
    """Open a run of `psfs reconstruct`; mesher: see `StoredClouds`. Raises InputError, or
    MissingFileError."""
    run = ReconstructionFolder.open(folder)
    remarks: list[str] = []
    run.warn_if_unfinished(remarks.append)
    if not run.indices:
        raise InputError(f"{folder}: holds no reconstructed frame; expected at least one")
    sequence = try_footage(run.sequence, remarks)
    fps = float(run.summary["sequence"].get("fps") or 25.0)
    clouds = StoredClouds(run, mesher)
    return Opened(folder, np.array(run.indices), fps, sequence, clouds, tuple(remarks))


def try_footage(open_footage: Callable[[], Sequence], remarks: list[str]) -> Sequence | None:
    """Return the footage, or add a remark why there is none."""
    try:
        return open_footage()
    except UserError as error:
        remarks.append(f"no pictures: {error}")
        return None
