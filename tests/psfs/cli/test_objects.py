"""Things that do not stand on the floor: a statue below the origin of a world with Y up."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers import footage, scenes
from helpers.commands import succeed

from psfs.cameras.camera import CameraRig
from psfs.cameras.units import rotate_rig, rotation_to_z_up
from psfs.output.reconstruction_folder import ReconstructionFolder

#: Of the test body, which is moved down.
LOW, HIGH = 0.2 - 1.8, 1.6 - 1.8


@pytest.fixture(scope="module")
def statue(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of masks of a statue below y = 0, eight cameras around it."""
    folder = tmp_path_factory.mktemp("statue")
    places = [(np.pi / 4 * k, 3, -0.9 + 0.5 * (-1) ** k) for k in range(8)]
    cameras = scenes.pinholes(places, [0, 0, -0.9], (160, 120), 150)
    views = [[scenes.draw_points(c, scenes.solid_points() - [0, 0, 1.8], 3)] for c in cameras]
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
    assert heights(out) == pytest.approx((LOW, HIGH), abs=0.06)
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
