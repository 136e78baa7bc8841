"""`psfs reconstruct`, `check` and `view` on a small folder with ready masks."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from helpers import faults
from helpers.commands import fail, succeed

import psfs.cli.reconstruct as command
from psfs.output.preview import draw_preview
from psfs.voxels.clouds import read_cloud

FRAMES = 4


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A native folder of five cameras; the body is there in all frames but the first. The masks of
    the third are the true ones."""
    walk = faults.masks_folder(tmp_path_factory.mktemp("walk"), FRAMES)
    (walk / "truth_masks").mkdir()
    for camera in (walk / "masks").iterdir():
        shutil.copy(sorted(camera.iterdir())[2], walk / "truth_masks" / f"{camera.name}_000002.png")
    return walk


def reconstruct(folder: Path, out: Path, *flags: str) -> list[str]:
    return ["psfs", "reconstruct", str(folder), "-o", str(out), "--voxel-size", "0.04", *flags]


def test_reconstruct_then_check_then_view(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "draw_preview", draw_preview)
    out = tmp_path / "out"
    assert "warning" not in succeed(*reconstruct(folder, out)).err
    summary = json.loads((out / "summary.json").read_text())
    assert summary["complete"] and len(summary["frames"]) == FRAMES
    assert summary["frames"][0]["surface_voxels"] == 0
    cloud = read_cloud(out / "clouds" / "frame_000001.npz")
    assert len(cloud) == summary["frames"][1]["surface_voxels"] > 100
    assert len(trimesh.load(out / "clouds" / "frame_000001.ply").vertices) == len(cloud)
    assert cv2.imread(str(out / "preview.png")).shape[1] == 1800

    said = succeed("psfs", "check", out).out
    report = json.loads((out / "check.json").read_text())
    assert report["mean_iou"] > 0.8 and len(report["cameras"]) == 5
    assert report["frames"]["0"] == [None] * 5
    truth = report["truth"]
    assert truth["frames"] == 1 and 0.8 < truth["iou"] <= truth["ceiling"] + 0.05
    assert f"true masks of 1 frames: IoU {truth['iou']:.3f}" in said

    succeed("psfs", "view", str(out), "--frame", "2", "--png", str(tmp_path / "view.png"))
    assert cv2.imread(str(tmp_path / "view.png")).shape[1] == 1800


def test_a_track_of_the_take_and_of_another(folder: Path, tmp_path: Path) -> None:
    """The trunk that the test body's masks hold, and the same beside them."""
    flags = ("--frames", "1:3", "--volume", "-0.5,0.6,-0.5,0.5,0,1.8")
    trunk = np.array([0, 0, 0.4, 0.2, 0, 0, 1.0, 0.2, 1, 0, 0, 0, 0, 1, 0, 0], "f4")
    cones = np.tile(trunk, (FRAMES, 1, 1))
    track = tmp_path / "track.npz"
    np.savez(track, frames=np.arange(FRAMES), cones=cones)
    succeed(*reconstruct(folder, tmp_path / "own", *flags, "--track", str(track)))
    assert f'track = "{track}"' in (tmp_path / "own" / "settings.toml").read_text()
    np.savez(track, frames=np.arange(FRAMES), cones=cones + np.eye(16)[0] + np.eye(16)[4])
    said = fail(*reconstruct(folder, tmp_path / "other", *flags, "--track", str(track)))
    assert "of the body's axes lie on the silhouettes of walk" in said
    np.savez(track, frames=np.arange(1), cones=cones[:1])
    said = fail(*reconstruct(folder, tmp_path / "other", *flags, "--track", str(track)))
    assert "lacks the frames 1-2; expected" in said
    assert not (tmp_path / "other").exists()


def test_voxels_finer_than_the_pixels_are_warned_of(folder: Path, tmp_path: Path) -> None:
    small = ["--frames", "1:2", "--volume", "-0.01,0.01,-0.01,0.01,1,1.02"]
    command = ["reconstruct", str(folder), "-o", str(tmp_path / "out"), "--grid", "20,20,20"]
    assert "8,000 voxels of 1 mm: finer than the pictures" in succeed("psfs", *command, *small).err
