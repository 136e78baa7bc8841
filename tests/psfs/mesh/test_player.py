"""The viewer's state and its keys, without a window."""

from __future__ import annotations

import numpy as np
from helpers import scenes

from psfs.mesh.drawing import Lines, SurfaceDrawing, make_static_layer, make_voxel_layer
from psfs.mesh.keys import KEYS
from psfs.mesh.playback import Playback
from psfs.mesh.player import Player
from psfs.voxels.grid import VoxelCloud

LINES = Lines(np.zeros((2, 3)), np.array([[0, 1]]), np.zeros((1, 3), np.uint8))


def cloud_of(count: int) -> VoxelCloud:
    return VoxelCloud(scenes.small_grid(), 99 + np.arange(count), np.ones(count, np.float32))


def player() -> Player:
    voxels = make_voxel_layer(lambda frame: (cloud_of(frame), None), scenes.small_grid())
    layers = (voxels, make_static_layer("floor", LINES))
    return Player(Playback([0, 2, 3], 10.0, 2), layers, lambda frame: f"{frame} voxels")


def shown_voxels(shown: Player) -> int:
    surface = shown.drawings()["voxels"]
    assert isinstance(surface, SurfaceDrawing)
    return len(surface.vertices) // 8


def test_frames_and_layers() -> None:
    shown = player()
    assert shown_voxels(shown) == 2 and shown.drawings()["floor"] is LINES
    assert shown.press("right") and shown_voxels(shown) == 3
    assert shown.press("home") and list(shown.drawings()) == ["floor"]  # nobody there
    assert shown.press("end") and shown_voxels(shown) == 3
    assert shown.press("left") and shown_voxels(shown) == 2
    assert shown.press("2") and list(shown.drawings()) == ["voxels"]
    assert shown.press("2") and shown.press("1") and list(shown.drawings()) == ["floor"]
    assert not shown.press("3") and not shown.press("x")


def test_what_has_not_changed_is_the_same_object() -> None:
    shown = player()
    before = shown.drawings()
    shown.press("space")
    shown.press("up")
    assert shown.playback.playing and shown.playback.speed == 2
    assert shown.drawings() == before
    shown.press("c")
    after = shown.drawings()
    assert after["floor"] is before["floor"] and after["voxels"] is not before["voxels"]
    shown.press("down")
    assert shown.playback.speed == 1


def test_every_key_of_the_help_is_somebodys() -> None:
    window = {"r", "q"}
    assert {key for key in KEYS if not player().press(key)} == window


def test_colourings_go_round() -> None:
    shown = player()
    seen = []
    for _ in range(3):
        shown.press("c")
        seen.append(shown.colouring)
    assert seen == ["probability", "height", "colour"]


def test_the_caption_says_frame_time_and_size() -> None:
    assert player().caption() == "frame 2   0.20 s   speed 1   2 voxels"
