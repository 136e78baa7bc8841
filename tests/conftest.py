"""Fixtures that many tests share: every OpenCL device, a small walk, a stored run."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import footage, scenes

from apf.synthetic.generate import generate
from apf.synthetic.scene import SceneConfig
from cl import Device, list_devices, select_device
from psfs.cli import main


@pytest.fixture(scope="session", params=[info.name for info in list_devices()])
def device(request: pytest.FixtureRequest) -> Device:
    """Each OpenCL device of this machine in turn."""
    chosen = select_device(request.param)
    assert isinstance(chosen, Device)
    return chosen


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a synthetic walk: 4 cameras, 5 frames."""
    folder = tmp_path_factory.mktemp("walk") / "walk"
    config = SceneConfig(cameras=4, frames=5, fps=60, size=(320, 240), seed=4)
    generate(folder, config, Device.best())
    return folder


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of three frames of five cameras, of which the first shows nobody."""
    folder = tmp_path_factory.mktemp("walk")
    rig = scenes.ring(5, size=(160, 120))
    footage.write_toml(folder / "calibration.toml", footage.tables(rig))
    for camera, mask in zip(rig, scenes.masks_of(rig), strict=True):
        target = folder / "masks" / camera.name
        target.mkdir(parents=True)
        for frame in range(3):
            picture = mask[: camera.size[1], : camera.size[0]] * np.uint8(frame > 0)
            cv2.imwrite(str(target / f"{frame:04d}.png"), picture)
    out = folder / "out"
    assert main(["reconstruct", str(folder), "-o", str(out), "--voxel-size", "0.04"]) == 0
    return out
