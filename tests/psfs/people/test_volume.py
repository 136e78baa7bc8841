"""The volume of several people holds all of them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from helpers import footage, scenes

import psfs
from cl import Device
from psfs.cameras.camera import CameraRig
from psfs.cameras.footprints import voxel_footprints
from psfs.people.separation import FAR, draw

STEP = 0.05


def somebody(x: float) -> np.ndarray:
    """Points of a block of 0.3 x 0.3 x 1.5 m that stands at x, y = 0."""
    ends = ((x - 0.15, x + 0.15), (-0.15, 0.15), (0.0, 1.5))
    axes = [np.arange(low, high, STEP) + STEP / 2 for low, high in ends]
    return np.stack(np.meshgrid(*axes), -1).reshape(-1, 3)


def film(folder: Path, points: np.ndarray) -> Path:
    """Write three frames of four cameras that show the same points, as masks."""
    rig = scenes.without_distortion(CameraRig(scenes.ring(4).cameras))
    footage.write_toml(folder / "calibration.toml", footage.tables(rig))
    prints = voxel_footprints(rig, STEP)
    for view, camera in enumerate(rig):
        shown = draw(camera, points, prints[view], camera.size[::-1])[0] < FAR
        (folder / "masks" / camera.name).mkdir(parents=True)
        for frame in range(3):
            path = folder / "masks" / camera.name / f"{frame:06d}.png"
            cv2.imwrite(str(path), np.where(shown, 255, 0).astype(np.uint8))
    return folder


def test_both_people_are_reconstructed(tmp_path: Path, device: Device) -> None:
    both = film(tmp_path, np.concatenate([somebody(-0.6), somebody(0.5)]))
    clouds = list(psfs.reconstruct(psfs.open_sequence(both), device=device, voxel_size=0.05))
    for cloud in clouds:
        assert cloud.centres[:, 0].min() < -0.65 and cloud.centres[:, 0].max() > 0.55
        assert not (np.abs(cloud.centres[:, 0] + 0.05) < 0.1).any()  # the gap between them
