"""`psfs mesh` on a small run with ready masks, and on the Middlebury dinosaur."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from helpers.commands import fail, succeed
from helpers.shared import shared_data
from scipy import spatial

from cl import Device, NumpyDevice, select_device
from psfs.mesh.marching_cubes import Mesher
from psfs.mesh.preview import load_open3d
from psfs.output.reconstruction_folder import ReconstructionFolder
from psfs.sequence import Sequence


def test_one_frame_checked(out: Path, tmp_path: Path) -> None:
    path = tmp_path / "body.glb"
    succeed("psfs", "mesh", str(out), "-o", str(path), "--check")
    report = json.loads((out / "mesh_check.json").read_text())
    assert list(report["frames"]) == ["1"]  # the first that shows something
    assert report["frames"]["1"]["watertight"] and report["mean_iou"] > 0.85
    assert len(report["frames"]["1"]["iou"]) == 5
    volume = ReconstructionFolder.open(out).cloud(1).volume
    assert report["frames"]["1"]["volume_m3"] == pytest.approx(volume, rel=0.08)
    assert path.stat().st_size > 10_000


def test_a_check_without_open3d_says_what_to_install(
    out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    load_open3d.cache_clear()
    monkeypatch.setitem(sys.modules, "open3d", None)
    assert "[mesh]'" in fail("psfs", "mesh", out, "--check")


def test_all_frames_but_the_empty_one(out: Path, tmp_path: Path) -> None:
    succeed("psfs", "mesh", str(out), "--frame", "all", "--format", "obj")
    names = sorted(path.name for path in (out / "meshes").iterdir())
    assert names == ["frame_000001.obj", "frame_000002.obj"]
    succeed("psfs", "mesh", str(out), "--frame", "all", "-o", str(tmp_path), "--smooth", "0")
    smooth = trimesh.load(out / "meshes" / "frame_000002.obj", process=False)
    rough = trimesh.load(tmp_path / "frame_000002.ply", process=False)
    assert len(smooth.vertices) == len(rough.vertices)
    assert np.abs(smooth.vertices - rough.vertices).max() > 1e-3


@pytest.mark.parametrize("device", [select_device("auto"), NumpyDevice()])
def test_the_surface_is_that_of_the_run(out: Path, device: Device | NumpyDevice) -> None:
    """Computed anew in a box around the cloud, it passes between the cloud's voxels and others."""
    run = ReconstructionFolder.open(out)
    mesher = Mesher(device, run, run.sequence(), smoothing=0)
    for index in (1, 2):  # the second is placed into the first one's grid
        mesh, cloud = mesher(index), run.cloud(index)
        assert mesh.is_watertight
        distance, _ = spatial.cKDTree(cloud.centres).query(mesh.vertices)
        assert distance.max() <= cloud.grid.voxel_size * 1.0001
        distance, _ = spatial.cKDTree(mesh.vertices).query(cloud.centres)
        assert distance.max() <= cloud.grid.voxel_size * np.sqrt(3)  # closed: diagonals, too


def test_the_dinosaur_is_watertight_and_fills_its_silhouettes(tmp_path: Path) -> None:
    folder = shared_data("middlebury_dino")
    size = ["--volume", "-0.064,0.022,-0.068,0.019,-0.035,0.075", "--voxel-size", "0.002"]
    size += ["--no-colour", "--cameras", ",".join(Sequence.open(folder).rig.names[::2])]
    succeed("psfs", "reconstruct", str(folder), "-o", str(tmp_path), *size)
    succeed("psfs", "mesh", str(tmp_path), "--check")
    report = json.loads((tmp_path / "mesh_check.json").read_text())
    assert report["frames"]["0"]["watertight"] and report["mean_iou"] >= 0.95
    mesh = trimesh.load(tmp_path / "meshes" / "frame_000000.ply")
    assert isinstance(mesh, trimesh.Trimesh) and mesh.is_watertight
