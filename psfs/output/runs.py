"""The output folder of `psfs reconstruct`: what it holds and how to find one's way back."""

from __future__ import annotations

import json
import platform
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from cl import Device, InputError, MissingFileError, NumpyDevice
from psfs.reconstructor import ReconstructionConfig
from psfs.sequence import Sequence
from psfs.voxels.clouds import read_cloud
from psfs.voxels.grid import VoxelCloud, VoxelGrid

SUMMARY = "summary.json"


def cloud_stem(out: Path, index: int) -> Path:
    """Return the path of frame `index`'s cloud without suffix."""
    return out / "clouds" / f"frame_{index:06d}"


def versions() -> dict[str, str]:
    """Return the versions of what computed: this program, Python and the libraries that matter."""
    packages = ("psfs-apf", "numpy", "pyopencl", "opencv-python-headless", "scipy")
    found = {"python": platform.python_version()}
    for package in packages:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:  # another flavour of the same library
            found[package] = "unknown"
    return found


def device_facts(device: Device | NumpyDevice) -> dict[str, Any]:
    return dict(vars(device.info)) if isinstance(device, Device) else {"name": device.name}


def grid_facts(grid: VoxelGrid) -> dict[str, Any]:
    return {
        "origin_m": grid.origin.tolist(),
        "high_m": grid.high.tolist(),
        "voxel_size_m": grid.voxel_size,
        "shape": list(grid.shape),
    }


@dataclass(frozen=True)
class Run:
    """A finished (or interrupted) `psfs reconstruct`."""

    out: Path
    summary: dict[str, Any]

    @classmethod
    def open(cls, out: Path) -> Run:
        """Read the summary in `out`. Raises InputError, or MissingFileError, if it holds no run."""
        path = out / SUMMARY
        try:
            summary = json.loads(path.read_text())
            for key in ("sequence", "grid", "config", "frames"):
                summary[key]
        except FileNotFoundError:
            raise MissingFileError(
                f"{path}: no such file; expected the summary of a `psfs reconstruct`"
            ) from None
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(
                f"{path}: not the summary of a `psfs reconstruct` ({error})"
            ) from error
        return cls(out, summary)

    @property
    def indices(self) -> list[int]:
        """Numbers of the frames that were reconstructed."""
        return [int(frame["index"]) for frame in self.summary["frames"]]

    def chosen(self, number: int | None) -> int:
        """Return the frame `number`, or the first that shows something. Raises InputError if it is
        not among those reconstructed."""
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
        """The parameters. Raises InputError if they are those of another version."""
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
        grid = self.summary["grid"]
        nx, ny, nz = grid["shape"]
        return VoxelGrid(np.array(grid["origin_m"]), grid["voxel_size_m"], (nx, ny, nz))

    def cloud(self, index: int) -> VoxelCloud:
        return read_cloud(cloud_stem(self.out, index).with_suffix(".npz"))

    def sequence(self) -> Sequence:
        """Open the sequence again. Raises MissingFileError if its folder has gone."""
        stated = self.summary["sequence"]
        for folder in (Path(stated["folder"]), Path(stated["absolute"])):
            if folder.is_dir():
                return Sequence.open(folder, **stated["overrides"])
        raise MissingFileError(
            f"{self.out / SUMMARY}: its sequence {stated['absolute']} is gone; expected a folder"
        )
