"""`psfs view`: what its page shows, its keys, and the picture with --png."""

import http.client
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.studio import save_voxels

import psfs.cli.view as command
from psfs.cli import main


@pytest.mark.parametrize("flags", [(), ("--mesh",)])
def test_a_picture_without_a_page(out: Path, tmp_path: Path, flags: tuple[str, ...]) -> None:
    path = tmp_path / "view.png"
    assert main(["view", str(out), "--frame", "2", "--png", str(path), *flags]) == 0
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
        assert main(["view", str(folder), "--port", "0", *flags]) == 0

    return show


def test_page_plays_the_voxels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = save_voxels(tmp_path / "<b>voxels")

    def look(watch) -> None:  # type: ignore[no-untyped-def]
        assert watch.opened.frames.tolist() == [0, 1, 2, 3] and watch.frame == 2
        assert "50 voxels, 10 l" in watch.status and "<b>" not in watch.remarks
        first = watch.voxels.shown
        assert len(first.positions) == 50
        keys = {key: do for _, key, do in watch.list_keys()}
        keys["V"]()
        assert watch.colouring.value == "probability" and "gradient" in watch.scale
        yellow = watch.voxels.shown.colours
        assert (yellow == yellow[0]).all() and (yellow != first.colours).any()
        keys["V"]()
        keys["V"]()
        assert watch.scale == "" and (watch.voxels.shown.colours == first.colours).all()
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


def test_bad_use_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = save_voxels(tmp_path / "voxels")
    assert main(["view", str(folder), "--port", "70000"]) == 2
    assert main(["view", str(folder), "--frame", "9"]) == 2
    monkeypatch.setitem(sys.modules, "viser", None)
    assert main(["view", str(folder)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert "--port" in lines[0] and "holds frames 0 to 3" in lines[1]
    assert "[studio]'" in lines[2] and "--png FILE" in lines[2]
