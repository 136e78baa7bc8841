"""`psfs calibrate --refine` on a take of masks: corrected if off, kept if sound."""

import json
from pathlib import Path

import numpy as np
from helpers import footage, scenes
from helpers.commands import fail, succeed

from psfs.cameras.calibration import read_calibration
from psfs.cameras.camera import CameraRig

EXACT = scenes.without_distortion(scenes.ring(4, (320, 240), 4.0))


def film(folder: Path, frames: int, rig: CameraRig = EXACT) -> Path:
    """Write masks as the exact cameras show them, with the calibration of `rig`."""
    people = [scenes.limbs(frame) for frame in range(frames)]
    views = [[scenes.draw_points(camera, each, 7) for each in people] for camera in EXACT]
    return footage.write_take(folder, rig, views)


def refine(take: Path, out: Path) -> dict[str, object]:
    succeed("psfs", "calibrate", take, "--refine", "--device", "numpy", "-o", out)
    return dict(json.loads((out / "calibration.json").read_text()))


def test_a_take_corrects_its_cameras(tmp_path: Path) -> None:
    turns = np.radians([[0.5, 0.3, 0], [-0.5, 0.4, 0.2], [0.1, -0.6, 0.3], [-0.2, 0, -0.6]])
    wrong = CameraRig(tuple(map(scenes.turned, EXACT, turns)))
    report = refine(film(tmp_path / "take", 14, wrong), tmp_path / "out")
    assert report["corrected"] is True
    corrected = read_calibration(tmp_path / "out" / "calibration.toml")
    before, after = (scenes.pixels_apart(rig, EXACT, scenes.limbs(0)) for rig in (wrong, corrected))
    assert after < 0.7 * before
    cameras = report["cameras"]
    assert isinstance(cameras, dict) and set(cameras) == set(EXACT.names)
    late = cameras["c0"]["late_frames"]
    assert abs(late["value"]) < 4 * late["standard_deviation"]


def test_sound_cameras_are_kept(tmp_path: Path) -> None:
    report = refine(film(tmp_path / "take", 12), tmp_path / "out")
    assert report["corrected"] is False
    kept = read_calibration(tmp_path / "out" / "calibration.toml")
    assert scenes.pixels_apart(kept, EXACT, scenes.limbs(0)) < 1e-3
    assert "are kept" in str(report["verdict"])


def test_two_cameras_are_refused(tmp_path: Path) -> None:
    take = film(tmp_path / "take", 1)
    flags = ["--refine", "--cameras", "c0,c1", "-o", str(tmp_path / "out")]
    assert "expected three or more" in fail("psfs", "calibrate", take, *flags)
    said = fail("psfs", "calibrate", take, "--refine", "--floor", "0", "-o", tmp_path / "out")
    assert "applies only to boards and wands" in said
