"""Things that do not stand on the floor: a statue below the origin of a world with Y up."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import footage, scenes
from helpers.commands import succeed

from psfs.cameras.camera import CameraRig
from psfs.cameras.units import rotate_rig, rotation_to_z_up
from psfs.output.reconstruction_folder import ReconstructionFolder

HEIGHT = 1.8


@pytest.fixture(scope="module")
def statue(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of masks: legs, trunk and head from y = -1.8 to 0, eight cameras around them."""
    folder = tmp_path_factory.mktemp("statue")
    rng = np.random.default_rng(0)
    points = rng.uniform([-0.3, -0.3, -HEIGHT], [0.3, 0.3, 0], (120_000, 3))
    x, y, z = points.T
    legs = (np.hypot(np.abs(x) - 0.12, y) < 0.09) & (z < -0.9)
    trunk = (np.hypot(x, 1.5 * y) < 0.26) & (z > -0.95) & (z < -0.3)
    head = np.linalg.norm(points - [0, 0, -0.15], axis=1) < 0.15
    points = points[legs | trunk | head]
    cameras, views, closing = [], [], (cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
    for k in range(8):
        angle = 2 * np.pi * k / 8
        centre = np.array([3 * np.cos(angle), 3 * np.sin(angle), -0.9 + 0.5 * (-1) ** k])
        camera = scenes.looking_at(f"c{k}", centre, np.array([0, 0, -0.9]), (160, 120), 150.0)
        cameras.append(replace(camera, distortion=np.zeros(5)))
        views.append([cv2.morphologyEx(scenes.draw_points(cameras[-1], points), *closing)])
    y_up = rotate_rig(CameraRig(tuple(cameras)), rotation_to_z_up("y").T)
    footage.write_take(folder, y_up, views)
    (folder / "sequence.toml").write_text('up = "y"\nfps = 1\n')
    return folder


def heights(out: Path) -> tuple[float, float]:
    z = ReconstructionFolder.open(out).cloud(0).centres[:, 2]
    return float(z.min()), float(z.max())


def mean_iou(out: Path) -> float:
    return float(json.loads((out / "check.json").read_text())["mean_iou"])


@pytest.mark.parametrize("flags", [[], ["--subject", "object"]])
def test_it_is_whole_without_a_flag(statue: Path, tmp_path: Path, flags: list[str]) -> None:
    out = tmp_path / "out"
    succeed("psfs", "reconstruct", str(statue), "-o", str(out), *flags)
    low, high = heights(out)
    assert low == pytest.approx(-HEIGHT, abs=0.06) and high == pytest.approx(0, abs=0.06)
    captured = succeed("psfs", "check", out)
    assert "warning" not in captured.out + captured.err
    assert mean_iou(out) > 0.85
    assert (ReconstructionFolder.open(out).grid.voxel_size < 0.018) == bool(
        flags
    )  # follows the object


def test_a_volume_that_cuts_it_is_said_and_counts(statue: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    command = ["reconstruct", str(statue), "-o", str(out)]
    said = succeed("psfs", *command, "--volume", "-0.5,0.5,-0.5,0.5,-0.8,0.2").err
    assert "the volume cuts what is filmed" in said
    assert "the volume cuts what is filmed" in succeed("psfs", "check", out).out
    assert mean_iou(out) < 0.75
