"""`psfs view`: the window's contents, and the picture without a display."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import cv2
import numpy as np
import pytest
from helpers import scenes

import psfs.cli.view as command
from cl import InputError
from psfs.cli import main
from psfs.common.open3d import load_open3d
from psfs.mesh import viewer
from psfs.mesh.drawing import Lines, SurfaceDrawing, make_cubes, make_static_layer, make_voxel_layer
from psfs.mesh.playback import Playback
from psfs.mesh.player import Player
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


@pytest.mark.parametrize("name", ["voxels", "meshes"])
def test_the_window_gets_the_whole_run(
    out: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    seen: dict[str, Any] = {}

    def show(title: str, rig: Any, grid: Any, player: Player) -> None:
        seen.update(player=player)

    monkeypatch.setattr(command, "has_display", lambda: True)
    monkeypatch.setattr(command, "show_window", show)
    assert main(["view", str(out), *(["--mesh"] if name == "meshes" else [])]) == 0
    player: Player = seen["player"]
    assert player.playback.frames == [0, 1, 2] and player.playback.frame == 1
    assert list(player.drawings()) == [name, "cameras", "floor"]
    surface = player.drawings()[name]
    assert (
        isinstance(surface, SurfaceDrawing) and len(surface.colours) == len(surface.vertices) > 1000
    )
    assert " voxels, " in player.caption()
    player.press("left")  # nobody there
    assert list(player.drawings()) == ["cameras", "floor"]


def test_drawings_in_open3ds_form() -> None:
    cloud = VoxelCloud(scenes.small_grid(), np.arange(3), np.ones(3, np.float32))
    vertices, faces = make_cubes(cloud)
    red = np.tile(np.uint8([255, 0, 0]), (len(vertices), 1))
    mesh = viewer.convert_to_open3d(SurfaceDrawing(vertices, faces, np.zeros_like(vertices), red))
    assert len(mesh.triangles) == 36 and len(mesh.vertex_normals) == 24
    np.testing.assert_allclose(np.asarray(mesh.vertex_colors)[0], [1, 0, 0])
    lines = viewer.convert_to_open3d(Lines(np.eye(3), np.array([[0, 1]]), np.uint8([[0, 0, 255]])))
    assert len(lines.points) == 3 and len(lines.lines) == 1
    np.testing.assert_allclose(np.asarray(lines.colors), [[0, 0, 1]])


def test_a_window_that_does_not_open_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    class NoWindow:
        def initialize(self) -> None: ...

        def create_window(self, *_: object) -> None:
            raise RuntimeError("Failed to load vulkan library!")

    class Gui:
        class Application:
            instance = NoWindow()

    monkeypatch.setattr(load_open3d().visualization, "gui", Gui)
    player = Player(Playback([1], 30.0, 1), ())
    with pytest.raises(InputError, match=r"vulkan library.*--png FILE"):
        viewer.show_window("walk", scenes.ring(2), scenes.small_grid(), player)


class FakeGui:
    """A substitute for Open3D's gui without a display: `script(window)` runs instead of the event
    loop."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, script: Any) -> None:
        visualization = load_open3d().visualization
        gui = MagicMock()
        gui.KeyName = visualization.gui.KeyName
        self.window = gui.Application.instance.create_window.return_value
        self.window.theme.font_size = 16
        gui.Application.instance.run.side_effect = script
        monkeypatch.setattr(visualization, "gui", gui)
        rendering = MagicMock()
        monkeypatch.setattr(visualization, "rendering", rendering)
        self.gui, self.scene = gui, rendering.Open3DScene.return_value

    def __getattr__(self, name: str) -> Any:
        """Return the window's callback `on_key` or `on_tick_event`."""
        return getattr(self.window, f"set_{name}").call_args.args[0]

    def press(self, name: str) -> bool:
        down = self.gui.KeyEvent.Type.DOWN
        return self.on_key(SimpleNamespace(key=self.gui.KeyName[name].value, type=down))

    def drawn(self) -> list[str]:
        """Return the layers drawn since the last call."""
        names = [call.args[0] for call in self.scene.add_geometry.call_args_list]
        self.scene.add_geometry.reset_mock()
        return names


def a_player(shape: Any) -> Player:
    lines = Lines(np.eye(3), np.array([[0, 1]]), np.zeros((1, 3), np.uint8))
    layers = make_voxel_layer(shape, scenes.small_grid()), make_static_layer("floor", lines)
    return Player(Playback([1, 2, 3], 1000.0, 1), layers)


def test_a_session_at_the_window(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keys, slider and time change the drawings; only those that change are redrawn."""

    def shape(frame: int) -> tuple[VoxelCloud, None]:
        return VoxelCloud(scenes.small_grid(), np.arange(frame), np.ones(frame, np.float32)), None

    player = a_player(shape)

    def script() -> None:
        assert fake.drawn() == ["voxels", "floor"]
        assert fake.press("RIGHT") and fake.drawn() == ["voxels"]
        fake.scene.remove_geometry.assert_called_once_with("voxels")
        assert fake.press("C") and fake.drawn() == ["voxels"]
        assert fake.press("R") and fake.press("UP") and fake.drawn() == []
        assert fake.press("TWO") and fake.drawn() == []
        assert fake.scene.remove_geometry.call_args.args == ("floor",)
        assert fake.press("TWO") and fake.drawn() == ["floor"]
        assert not fake.press("X") and not fake.press("F1")
        slider = fake.gui.Slider.return_value
        slider.set_on_value_changed.call_args.args[0](2.0)
        assert player.playback.frame == 3 and fake.drawn() == ["voxels"]
        assert not fake.on_tick_event()  # paused
        fake.press("SPACE")
        while not fake.on_tick_event():
            pass
        assert fake.drawn() == ["voxels"] and slider.int_value == player.playback.position
        fake.press("Q")
        fake.window.close.assert_called_once_with()

    fake = FakeGui(monkeypatch, script)
    viewer.show_window("walk", scenes.ring(2), scenes.small_grid(), player)


def test_an_error_closes_the_window(monkeypatch: pytest.MonkeyPatch) -> None:
    def shape(frame: int) -> tuple[VoxelCloud, None]:
        if frame == 2:
            raise InputError("frame_000002.npz: no such file")
        return VoxelCloud(scenes.small_grid(), np.arange(3), np.ones(3, np.float32)), None

    def script() -> None:
        fake.press("RIGHT")
        fake.window.close.assert_called_once_with()

    fake = FakeGui(monkeypatch, script)
    with pytest.raises(InputError, match="no such file"):
        viewer.show_window("walk", scenes.ring(2), scenes.small_grid(), a_player(shape))
