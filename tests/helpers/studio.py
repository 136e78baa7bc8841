"""Folders for the page: a track without footage, and voxels in the format of psfs reconstruct."""

import json
from pathlib import Path

import numpy as np

from helpers import tracks
from psfs.output.reconstruction_folder import cloud_stem, grid_facts
from psfs.voxels.clouds import write_npz
from psfs.voxels.config import ReconstructionConfig
from psfs.voxels.grid import VoxelCloud, VoxelGrid

GRID = VoxelGrid(np.array([-1.0, -1.0, 0.0]), 0.02, (100, 100, 100))


def save_track(folder: Path, n_frames: int = 30) -> Path:
    """Write a track whose footage is not known into a new folder."""
    tracks.walker(n_frames).save(folder / "track.npz")
    return folder


def save_voxels(folder: Path, n_frames: int = 4, n_voxels: int = 50) -> Path:
    """Write random voxels, whose footage is gone, into a new folder."""
    (folder / "clouds").mkdir(parents=True)
    rng, frames = np.random.default_rng(0), []
    for number in range(n_frames):
        indices = np.sort(rng.choice(GRID.size, n_voxels, replace=False)).astype(np.int32)
        colour = rng.integers(0, 256, (n_voxels, 3), np.uint8)
        cloud = VoxelCloud(GRID, indices, np.ones(n_voxels, np.float32), colour)
        write_npz(cloud, cloud_stem(folder, number).with_suffix(".npz"))
        frames.append({"index": number, "surface_voxels": n_voxels, "volume_m3": 0.01})
    summary = {
        "sequence": {"absolute": str(folder / "gone"), "overrides": {}, "fps": 30.0},
        "grid": grid_facts(GRID),
        "config": ReconstructionConfig().to_dict(),
        "frames": frames,
    }
    (folder / "summary.json").write_text(json.dumps(summary))
    return folder
