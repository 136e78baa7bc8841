"""`psfs view`: what its page shows, its keys, looking through a camera, the picture with --png."""

import http.client
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.commands import fail, succeed
from helpers.scenes import ring
from helpers.studio import save_voxels

import psfs.cli.view as command
from psfs.page.pictures import crosses, find_straight_map, locate_point


def test_a_picture_of_a_mesh(out: Path, tmp_path: Path) -> None:
    path = tmp_path / "view.png"
    succeed("psfs", "view", str(out), "--frame", "2", "--png", str(path), "--mesh")
    picture = cv2.imread(str(path))
    assert picture is not None and picture.shape[1] == 1800
    outline = cv2.inRange(picture[420:], np.array([40, 180, 40]), np.array([80, 255, 80]))
    assert np.count_nonzero(outline) > 100


def watched(monkeypatch: pytest.MonkeyPatch, folder: Path, *flags: str) -> Callable[..., None]:
    """Return a function that shows `folder` and calls a function with the page's `Watch`."""

    def show(look: Callable) -> None:  # type: ignore[type-arg]
        pytest.importorskip("viser", reason="viser is not installed")

        def serve(page, args) -> None:  # type: ignore[no-untyped-def]
            asked = http.client.HTTPConnection("127.0.0.1", page.server.get_port(), timeout=60)
            asked.request("GET", "/")  # without the token
            assert asked.getresponse().status == 403
            look(page.watch)

        monkeypatch.setattr(command, "serve", serve)
        succeed("psfs", "view", str(folder), "--port", "0", *flags)

    return show


def test_page_plays_the_voxels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = save_voxels(tmp_path / "<b>voxels")

    def look(watch) -> None:  # type: ignore[no-untyped-def]
        assert watch.opened.frames.tolist() == [0, 1, 2, 3] and watch.frame == 2
        assert "50 voxels, 10 l" in watch.status.content and "<b>" not in watch.remarks.content
        first = watch.voxels.shown
        assert len(first.positions) == 50
        keys = {key: do for _, key, do in watch.list_keys()}
        keys["V"]()
        assert watch.colouring.value == "probability" and "gradient" in watch.scale.content
        yellow = watch.voxels.shown.colours
        assert (yellow == yellow[0]).all() and (yellow != first.colours).any()
        keys["V"]()
        keys["V"]()
        assert watch.scale.content == "" and (watch.voxels.shown.colours == first.colours).all()
        keys["1"]()
        assert not watch.voxels.visible
        keys["1"]()
        assert watch.voxels.visible

    watched(monkeypatch, folder, "--frame", "2")(look)


def test_page_shows_meshes(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def look(watch) -> None:  # type: ignore[no-untyped-def]
        assert watch.frame == 1  # nobody is there in the first one
        assert watch.voxels.shown.glb[:4] == b"glTF" and watch.voxels.visible
        watch.time_line.seek(0)
        assert not watch.voxels.visible

    watched(monkeypatch, out, "--mesh")(look)


def test_a_page_without_viser(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    said = fail("psfs", "view", save_voxels(tmp_path / "voxels"))
    assert "[studio]'" in said and "--png FILE" in said


def test_pictures_are_shown_where_the_scene_has_them() -> None:
    camera = ring(1, (160, 120))[0]
    camera = replace(camera, distortion=np.array([-0.2, 0.05, 0.002, -0.001, 0.0]))
    point = camera.centre + camera.rays(np.array([[100.0, 40.0]]))[0]
    picture = np.zeros((120, 160, 3), np.uint8)
    cv2.circle(picture, (100, 40), 2, (255, 255, 255), -1)
    fov, aspect = 1.2, 1.5
    pixels = find_straight_map(camera, fov, aspect)
    shown = cv2.remap(picture, pixels, None, cv2.INTER_LINEAR).mean(axis=-1)  # type: ignore[call-overload]
    height, width = shown.shape
    x, y, depth = camera.R @ point + camera.t
    focal = height / 2 / np.tan(fov / 2)
    expected = np.array([x, y]) / depth * focal + np.array([width - 1, height - 1]) / 2
    rows, columns = np.indices(shown.shape)
    found = np.array([(columns * shown).sum(), (rows * shown).sum()]) / shown.sum()
    assert np.abs(found - expected).max() < 3 and width == round(1.5 * height)


def test_clicks_meet_at_the_joint() -> None:
    rig, joint = ring(4), np.array([0.2, -0.1, 1.1])
    rays = {view: 3 * (joint - rig[view].centre) for view in (0, 2, 3)}
    place, apart = locate_point(rays, rig)
    assert np.allclose(place, joint) and apart < 1e-9
    assert crosses(rays) and not crosses({0: rays[0], 2: rays[2]})  # 2 is opposite of 0
    rays[0] = rays[0] + np.array([0.0, 0.0, 0.3])
    assert locate_point(rays, rig)[1] > 0.02
