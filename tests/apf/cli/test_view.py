"""`apf view`: the track's layers in the window, and a picture where there is none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import pytest
from helpers.tracks import walker

import psfs.cli.view as command
from apf.body import load_body, save_body
from apf.cli import main
from psfs.mesh.player import Player


@pytest.fixture
def track(tmp_path: Path) -> Path:
    """The folder of a track of frames 1 and 2."""
    folder = tmp_path / "track"
    walker(2, start=1).save(folder / "track.npz")
    save_body(folder / "body.toml", load_body("song31"))
    return folder


def test_the_window_gets_skeleton_and_cones(
    out: Path, track: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: dict[str, Any] = {}

    def show(title: str, rig: Any, grid: Any, player: Player) -> None:
        seen.update(player=player)

    monkeypatch.setattr(command, "has_display", lambda: True)
    monkeypatch.setattr(command, "show_window", show)
    assert main(["view", str(out), str(track)]) == 0
    player: Player = seen["player"]
    assert list(player.drawings()) == ["voxels", "skeleton", "cones", "cameras", "floor"]
    player.press("home")
    assert list(player.drawings()) == ["cameras", "floor"]
    assert player.caption().endswith("not tracked")


def test_a_picture_without_a_window(
    out: Path, track: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "view.png"
    flags = ["view", str(out), str(track), "--png", str(path)]
    assert main([*flags, "--frame", "2"]) == 0
    picture = cv2.imread(str(path))
    assert picture is not None and picture.any()
    assert main([*flags, "--frame", "0"]) == 2
    assert "frame 0 was not tracked" in capsys.readouterr().err


def test_another_body_is_refused(
    out: Path, track: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", str(out), str(track), "--body", "rymut31_lower"]) == 2
    assert "not that of --body rymut31_lower" in capsys.readouterr().err
