"""The page and the overlay of several people."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import tracks
from helpers.browser import browser

from apf.cli import main
from apf.report.people_page import write_people_overlay, write_people_page
from apf.synthetic.config import SceneConfig
from apf.synthetic.generate import generate
from apf.tracking.people import PeopleTracks
from cl import Device
from psfs.sequence import Sequence

N = 6
FRAMES = np.arange(N)


def pair() -> PeopleTracks:
    """Return two walkers, of whom the second is visible in frames 2 to 4."""
    first = tracks.walker(N)
    poses = first.poses.copy()
    poses[:, first.dof_names.index("pelvis.tx")] += 0.8
    second = replace(first, poses=poses, joints=first.joints + np.array([0.8, 0, 0]))
    return PeopleTracks((first, second), FRAMES, (FRAMES, FRAMES[2:5]), 1, ("good", "bad"))


@pytest.fixture(scope="module")
def footage(device: Device, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("people") / "walk"
    generate(folder, SceneConfig(cameras=2, frames=N, size=(160, 120)), device)
    return folder


def test_people_are_drawn_while_they_are_seen(footage: Path, tmp_path: Path) -> None:
    sequence, path = Sequence.open(footage), tmp_path / "overlay.mp4"
    write_people_overlay(path, sequence, pair())
    alone = PeopleTracks(pair().tracks[:1], FRAMES, (FRAMES,))
    write_people_overlay(tmp_path / "alone.mp4", sequence, alone)
    both, one = (read(path) for path in (path, tmp_path / "alone.mp4"))
    changed = (np.abs(both.astype(int) - one).max(-1) > 60).sum((1, 2))
    assert len(both) == N
    assert changed[2:5].min() > 500
    assert changed[[0, 1, 5]].max() < 100  # compression


def read(path: Path) -> np.ndarray:
    video, frames = cv2.VideoCapture(str(path)), []
    while (found := video.read())[0]:
        frames.append(found[1])
    return np.stack(frames)


def test_content_of_the_page(tmp_path: Path) -> None:
    (tmp_path / "person1").mkdir()
    (tmp_path / "person1" / "report.html").write_text("its own")
    page = write_people_page(tmp_path, "a <walk>", pair(), tmp_path / "none.mp4").read_text()
    text = re.search(r'type="application/json">(.*?)</script>', page, re.S)
    assert text is not None
    content = json.loads(text[1])
    assert content["counts"] == [1, 1, 2, 2, 2, 1]
    one, two = content["people"]
    assert (one["page"], two["page"]) == ("person1/report.html", None)
    assert (two["verdict"], two["seen"], two["shown"]) == ("bad", "2-4", [0, 0, 1, 1, 1, 0])
    assert "1 more that moves is not followed" in content["lines"][1]


def test_people_are_switched_on_and_off(tmp_path: Path) -> None:
    path = write_people_page(tmp_path, "walk", pair(), tmp_path / "none.mp4")
    with browser() as opened:
        page = opened.new_page()
        page.set_default_timeout(120_000)  # a machine under load
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(path.as_uri())
        page.wait_for_selector("body[data-ready=yes]")
        count = "() => traces(%d).length"
        assert page.evaluate(count % 0) == 2  # bones and joints of one
        assert page.evaluate(count % 3) == 4
        page.locator("#people input").first.click()
        assert page.evaluate(count % 0) == 0
        assert page.evaluate(count % 3) == 2
        assert errors == []


def test_commands_take_all_people_or_say_why_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    both = pair()
    away = replace(both[1], diagnostics={**both[1].diagnostics, "lost": np.arange(N) < 2})
    replace(both, tracks=(both[0], away)).save(out)
    assert main(["export", str(out), "--to", "csv", "--raw", "-o", str(tmp_path / "files")]) == 0
    files = [tmp_path / "files" / f"person{k}" / "angles.csv" for k in (1, 2)]
    assert all(file.exists() for file in files)
    assert "the person was not there in frames 0-1" in capsys.readouterr().out
    assert main(["smooth", str(out), "-o", str(tmp_path / "smooth")]) == 0
    smooth = PeopleTracks.open(tmp_path / "smooth")
    assert [track.smoothing is not None for track in smooth] == [True, True]
    assert smooth.seen[1].tolist() == [2, 3, 4]
    assert main(["render", str(tmp_path), str(out), "-o", str(tmp_path / "pictures")]) == 2
    assert "each picture is of one body; expected one's folder, as" in capsys.readouterr().err


def test_folders_that_hold_no_track_of_a_body_say_what_they_hold(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for seed in (0, 1):
        tracks.walker(N).save(tmp_path / "seeds" / "person1" / f"seed{seed}" / "track.npz")
    track = tracks.walker(N)
    points = replace(track, body=None, dof_names=(), poses=track.poses[:, :0])
    points.save(tmp_path / "points" / "track.npz")
    for command, said in (
        (["export", "seeds"], f"2 runs; expected one, as {tmp_path}"),
        (["view", "seeds", "--png", "x.png"], f"2 runs; expected one, as {tmp_path}"),
        (["report", "points"], "triangulated points, which are not judged; expected the track of"),
        (
            ["view", "points", "--png", "x.png"],
            "expected another one: triangulated points have none",
        ),
    ):
        assert main([command[0], str(tmp_path / command[1]), *command[2:]]) == 2
        assert said in capsys.readouterr().err
