"""`apf view`: a track on the page, alone or in stored voxels, and a picture with --png."""

from pathlib import Path
from unittest.mock import Mock

import cv2
import numpy as np
import pytest
from helpers.commands import fail, succeed
from helpers.studio import save_track, save_voxels
from helpers.tracks import walker

pytest.importorskip("viser", reason="viser is not installed")

import psfs.cli.view as command
from psfs.page.watch import ViewPage


@pytest.fixture
def track(tmp_path: Path) -> Path:
    """The folder of a track of frames 1 and 2."""
    walker(2, start=1).save(tmp_path / "track" / "track.npz")
    return tmp_path / "track"


def test_body_among_voxels(track: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def look(page: ViewPage, args: object) -> None:
        watch = page.watch
        assert watch is not None and watch.frame == 1 and watch.voxels.visible
        assert list(watch.shown) == ["voxels", "body", "skeleton", "trails", "cameras"]
        assert np.allclose(watch.bodies["track"].joints.points, walker(2).joints[0], atol=1e-5)
        watch.time_line.seek(0)
        assert "not tracked in this frame" in watch.status.content
        assert not page.server.scene.get_handle_by_name("/people/0").visible

    looks = Mock(side_effect=look)
    monkeypatch.setattr(command, "serve", looks)
    voxels = save_voxels(tmp_path / "voxels")
    succeed("apf", "view", str(voxels), str(track), "--frame", "1", "--port", "0")
    looks.assert_called_once()


def test_a_track_is_shown_without_voxels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    monkeypatch.setattr(command, "serve", lambda page, args: seen.append(page.watch.frame))
    run = save_track(tmp_path / "run")
    words = ["view", str(run), "--port", "0"]
    succeed("apf", *words, "--frame", "7")
    assert seen == [7]
    wrong = ["--frame", "70"], ["--mesh"], ["--png", str(tmp_path / "view.png")]
    lines = [fail("apf", *words, *flags) for flags in wrong]
    assert "holds frames 0 to 29" in lines[0] and "--mesh" in lines[1] and "footage" in lines[2]


def test_a_picture_without_a_page(out: Path, track: Path, tmp_path: Path) -> None:
    path = tmp_path / "view.png"
    flags = ["view", str(out), str(track), "--png", str(path)]
    succeed("apf", *flags, "--frame", "2")
    picture = cv2.imread(str(path))
    assert picture is not None and picture.any()
    assert "frame 0 was not tracked" in fail("apf", *flags, "--frame", "0")
