"""`psfs reconstruct`, `check` and `view` on a small folder with ready masks."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from helpers import faults

import psfs.cli.reconstruct as command
from psfs.cli import main
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


def reconstruct(folder: Path, out: Path, *flags: str) -> int:
    return main(["reconstruct", str(folder), "-o", str(out), "--voxel-size", "0.04", *flags])


def test_reconstruct_then_check_then_view(
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(command, "draw_preview", draw_preview)
    out = tmp_path / "out"
    assert reconstruct(folder, out) == 0
    assert "warning" not in capsys.readouterr().err
    summary = json.loads((out / "summary.json").read_text())
    assert summary["complete"] and len(summary["frames"]) == FRAMES
    assert summary["frames"][0]["surface_voxels"] == 0
    cloud = read_cloud(out / "clouds" / "frame_000001.npz")
    assert len(cloud) == summary["frames"][1]["surface_voxels"] > 100
    assert len(trimesh.load(out / "clouds" / "frame_000001.ply").vertices) == len(cloud)
    assert cv2.imread(str(out / "preview.png")).shape[1] == 1800

    assert main(["check", str(out)]) == 0
    report = json.loads((out / "check.json").read_text())
    assert report["mean_iou"] > 0.8 and len(report["cameras"]) == 5
    assert report["frames"]["0"] == [None] * 5
    truth = report["truth"]
    assert truth["frames"] == 1 and 0.8 < truth["iou"] <= truth["ceiling"] + 0.05
    assert f"true masks of 1 frames: IoU {truth['iou']:.3f}" in capsys.readouterr().out

    assert main(["view", str(out), "--frame", "2", "--png", str(tmp_path / "view.png")]) == 0
    assert cv2.imread(str(tmp_path / "view.png")).shape[1] == 1800
    assert main(["view", str(out), "--frame", "9"]) == 2
    assert "frames 0 to 3" in capsys.readouterr().err


def test_a_track_of_the_take_and_of_another(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The trunk that the test body's masks hold, and the same beside them."""
    flags = ("--frames", "1:3", "--volume", "-0.5,0.6,-0.5,0.5,0,1.8")
    trunk = np.array([0, 0, 0.4, 0.2, 0, 0, 1.0, 0.2, 1, 0, 0, 0, 0, 1, 0, 0], "f4")
    cones = np.tile(trunk, (FRAMES, 1, 1))
    track = tmp_path / "track.npz"
    np.savez(track, frames=np.arange(FRAMES), cones=cones)
    assert reconstruct(folder, tmp_path / "own", *flags, "--track", str(track)) == 0
    assert f'track = "{track}"' in (tmp_path / "own" / "settings.toml").read_text()
    np.savez(track, frames=np.arange(FRAMES), cones=cones + np.eye(16)[0] + np.eye(16)[4])
    assert reconstruct(folder, tmp_path / "other", *flags, "--track", str(track)) == 2
    assert "of the body's axes lie on the silhouettes of walk" in capsys.readouterr().err
    np.savez(track, frames=np.arange(1), cones=cones[:1])
    assert reconstruct(folder, tmp_path / "other", *flags, "--track", str(track)) == 2
    assert "lacks the frames 1-2; expected" in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


def test_voxels_finer_than_the_pixels_are_warned_of(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small = ["--frames", "1:2", "--volume", "-0.01,0.01,-0.01,0.01,1,1.02"]
    command = ["reconstruct", str(folder), "-o", str(tmp_path / "out"), "--grid", "20,20,20"]
    assert main([*command, *small]) == 0
    assert "8,000 voxels of 1 mm: finer than the pictures" in capsys.readouterr().err


def test_check_names_what_is_missing(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(tmp_path)]) == 2
    assert "summary.json" in capsys.readouterr().err
    out = tmp_path / "out"
    assert reconstruct(folder, out, "--frames", "1:2") == 0
    summary = json.loads((out / "summary.json").read_text())
    summary["sequence"] |= {"relative": "gone", "absolute": "/gone"}
    (out / "summary.json").write_text(json.dumps(summary))
    capsys.readouterr()
    assert main(["check", str(out)]) == 2
    assert "/gone is gone" in capsys.readouterr().err
