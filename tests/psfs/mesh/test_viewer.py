"""`psfs view`: what the window would show, and the picture where there is none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from helpers import scenes

import psfs.cli.view as command
from cl import InputError
from psfs.cli import main
from psfs.common.open3d import load_open3d
from psfs.mesh import viewer
from psfs.voxels.grid import VoxelCloud


@pytest.fixture(autouse=True)
def no_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "has_display", lambda: False)


@pytest.mark.parametrize("flags", [(), ("--mesh",)])
def test_a_picture_without_a_display(out: Path, flags: tuple[str, ...]) -> None:
    assert main(["view", str(out), "--frame", "2", *flags]) == 0
    picture = cv2.imread(str(out / "view_000002.png"))
    assert picture is not None and picture.shape[1] == 1800
    outline = cv2.inRange(picture[420:], np.array([40, 180, 40]), np.array([80, 255, 80]))
    assert np.count_nonzero(outline) > 100
    (out / "view_000002.png").unlink()


def test_the_window_steps_through_the_frames(
    out: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seen: dict[str, Any] = {}

    def show(title: str, rig: Any, frames: Any, start: int, shape: Any) -> None:
        seen.update(frames=frames, start=start, shapes=[shape(frame) for frame in frames])

    monkeypatch.setattr(command, "has_display", lambda: True)
    monkeypatch.setattr(command, "show", show)
    assert main(["view", str(out), "--mesh"]) == 0
    assert seen["frames"] == [0, 1, 2] and seen["start"] == 1
    assert isinstance(seen["shapes"][0], VoxelCloud)  # nobody there
    assert all(isinstance(shape, trimesh.Trimesh) for shape in seen["shapes"][1:])


class Window:
    """As much of Open3D's window as stepping needs."""

    def __init__(self) -> None:
        self.geometry: list[Any] = []

    def add_geometry(self, geometry: Any, reset: bool = True) -> None:
        self.geometry.append(geometry)

    def remove_geometry(self, geometry: Any, reset: bool) -> None:
        self.geometry.remove(geometry)

    def get_view_control(self) -> Any:
        return load_open3d().visualization.ViewControl()


def cloud_of(index: int) -> VoxelCloud:
    """`index` voxels, red."""
    grid = scenes.small_grid()
    indices = 10_000 + 7 * np.arange(index)
    colour = np.tile(np.uint8([255, 0, 0]), (index, 1))
    return VoxelCloud(grid, indices, np.ones(index, np.float32), colour)


def test_stepping_goes_round() -> None:
    window = Window()
    player = viewer._Player(window, [1, 2, 3], 3, cloud_of)
    for by, voxels in ((1, 1), (1, 2), (-1, 1), (-1, 3)):
        assert player.step(by)
        (shown,) = window.geometry
        assert len(shown.triangles) == 12 * voxels
        np.testing.assert_allclose(np.asarray(shown.vertex_colors)[0], [1, 0, 0])
    player.toggle()
    assert player.playing


def test_voxels_are_shown_as_cubes_of_their_size() -> None:
    cloud = cloud_of(5)
    vertices, faces, normals, colours = viewer.cubes(cloud)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight and colours is not None and len(colours) == len(vertices)
    assert mesh.volume == pytest.approx(5 * cloud.grid.voxel_size**3)
    np.testing.assert_allclose(vertices.reshape(5, 8, 3).mean(1), cloud.centres)
    assert normals.shape == vertices.shape
    assert len(viewer.cubes(cloud_of(0))[0]) == 0


def test_a_window_that_does_not_open_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    class NoWindow:
        def create_window(self, *_: object) -> bool:
            return False

    open3d = load_open3d()
    monkeypatch.setattr(open3d.visualization, "VisualizerWithKeyCallback", NoWindow)
    with pytest.raises(InputError, match="--png FILE"):
        viewer.show("walk", scenes.ring(2), [1], 1, cloud_of)
