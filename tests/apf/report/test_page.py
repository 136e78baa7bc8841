"""The report's page in a browser: the player follows the slider, and no request leaves the page."""

import json
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import footage, tracks
from helpers.browser import browser
from helpers.commands import fail, succeed

from apf.report import PAGE
from apf.report.agreement import Agreement
from apf.report.page import encode_page_video, write_page
from apf.report.quality import Quality
from apf.report.summary import body_facts
from apf.tracking.people import PeopleTracks
from cl import InputError
from psfs.output.video import count_frames, write_video
from psfs.voxels.grid import VoxelCloud, VoxelGrid

FRAMES = 200
#: Bytes, of a page of so many frames.
MOST = 15_000_000


def quality_of(n_frames: int, n_voxels: int) -> Quality:
    """Return the quality of a track with random voxels and an arm that is doubtful in frames 3 and
    4."""
    track = tracks.walker(n_frames)
    lost = np.arange(n_frames) == 7
    track = replace(track, diagnostics={"lost": lost, "confidence": np.full(n_frames, 0.9)})
    rng = np.random.default_rng(0)
    grid = VoxelGrid(np.array([-2.0, -2.0, 0.0]), 0.02, (200, 200, 100))
    clouds = []
    for _ in range(n_frames):
        indices = np.sort(rng.choice(grid.size, n_voxels, replace=False)).astype(np.int32)
        colour = rng.integers(0, 256, (n_voxels, 3), np.uint8)
        clouds.append(VoxelCloud(grid, indices, np.ones(n_voxels, np.float32), colour))
    inside = np.full((n_frames, 6), 0.95)
    inside[3:5, 3] = 0.3
    iou = np.full((n_frames, 3), 0.8)
    iou[0, 1] = np.nan
    cameras = ("cam01", 'a"b</script><script>alert(1)</script>', "cam03")
    rows, explained = np.arange(n_frames), np.ones(n_frames)
    return Quality(
        track, Agreement(rows, cameras, iou, iou + 0.1, inside, explained, tuple(clouds))
    )


def noise_video(path: Path, n_frames: int, size: tuple[int, int]) -> Path:
    """Write a video as hard to compress as a recording's noise."""
    rng = np.random.default_rng(0)
    base = cv2.resize(rng.integers(0, 256, (40, 60, 3), np.uint8), size)
    with write_video(path, 25) as video:
        for number in range(n_frames):
            shifted = np.roll(base, 3 * number, axis=1)
            video.write(cv2.add(shifted, rng.integers(0, 12, shifted.shape, np.uint8)))
    return path


def page_of(quality: Quality, path: Path, video: Path) -> Path:
    summary = {
        "sequence": {"folder": "walk", "cameras": ["cam01"], "left_out": {}, "fps": 60.0},
        "complete": True,
        "frames_wanted": len(quality.track),
        "seconds": 1.0,
        "warnings": ["left out: cam09 <b>disagrees</b>"],
        "device": {"name": "a device"},
        "versions": {"psfs-apf": "0"},
        "body": body_facts(quality.track.its_body),
        "quality": quality.facts(),
        "files": ["track.npz"],
        "settings": "particles = 200\n",
    }
    write_page(path, "a <walk>", PeopleTracks.of(quality.track), video, quality, summary)
    return path


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("page")
    video = noise_video(folder / "overlay.mp4", FRAMES, (640, 480))
    return page_of(quality_of(FRAMES, 5000), folder / "report.html", video)


def test_a_page_of_200_frames_is_small(page_file: Path) -> None:
    assert page_file.stat().st_size < MOST
    text = page_file.read_text(encoding="utf-8")
    own = text.replace(re.search(r"<script>/\*.*?</script>", text, re.DOTALL)[0], "")  # type: ignore[index]
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", own)


def test_in_a_browser(page_file: Path) -> None:
    """The slider moves skeleton, voxels and video; the list of doubts leads to its frames; no
    request leaves the page; nothing in a name is run."""
    with browser() as chromium:
        page = chromium.new_page(viewport={"width": 1400, "height": 900})
        page.set_default_timeout(120_000)  # a machine under load
        asked: list[str] = []
        wrong: list[str] = []
        page.on("request", lambda request: asked.append(request.url))
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("dialog", lambda dialog: wrong.append(dialog.message))
        page.goto(page_file.as_uri())
        shown = "document.getElementById('player').dataset.row === '{}'"
        page.wait_for_function(shown.format(0))
        first = page.evaluate("[0, 2].map((i) => document.getElementById('player').data[i].x[0])")
        slider = page.locator("#slider")
        assert slider.get_attribute("max") == str(FRAMES - 1)
        slider.fill("120")
        page.wait_for_function(shown.format(120))
        moved = page.evaluate("[0, 2].map((i) => document.getElementById('player').data[i].x[0])")
        assert np.all(np.array(moved) != first)
        assert page.locator("#frame").inner_text().startswith("frame 120, 2.00 s")
        page.wait_for_function("document.querySelector('video').readyState >= 2")
        assert page.evaluate("document.querySelector('video').videoWidth") == 640
        assert page.evaluate("document.querySelector('video').currentTime") == pytest.approx(
            120.5 / 60, abs=0.01
        )
        page.locator("#lines a").nth(1).click()
        page.wait_for_function(shown.format(3))
        assert "left arm" in page.locator("#lines").inner_text()
        choices = page.locator("#angles-section select")
        joints = choices.first.locator("option").all_inner_texts()
        assert joints[:2] == ["knee", "hip"] and "shoulder" in joints
        assert page.title() == page.locator("#name").inner_text() == "a <walk>"
        assert [choices.nth(k).input_value() for k in (0, 1)] == ["knee", "hip"]
        curves = page.evaluate("document.getElementById('angles0').data.map((one) => one.name)")
        assert curves == [None, None, "left flexion", "right flexion"]
        assert page.locator("#warnings").inner_text() == "left out: cam09 <b>disagrees</b>"
        page.locator("#slider").focus()
        page.keyboard.press("ArrowRight")
        page.wait_for_function(shown.format(4))
    assert not wrong
    assert [url for url in asked if not url.startswith(("file:", "blob:", "data:"))] == []


def test_without_webgl_the_player_is_painted(page_file: Path) -> None:
    """Voxels and skeleton are there, move with the slider, and turn when they are dragged."""
    seen = "document.querySelector('#player canvas').toDataURL()"
    with browser("--disable-3d-apis") as chromium:
        page = chromium.new_page(viewport={"width": 900, "height": 700})
        page.set_default_timeout(120_000)
        page.goto(page_file.as_uri())
        page.wait_for_function("document.getElementById('player').dataset.row === '0'")
        pictures = [page.evaluate(seen)]
        page.locator("#slider").fill("120")
        page.wait_for_function("document.getElementById('player').dataset.row === '120'")
        pictures.append(page.evaluate(seen))
        page.mouse.move(200, 300)
        page.mouse.down()
        page.mouse.move(260, 300)
        pictures.append(page.evaluate(seen))
        assert len(set(pictures)) == 3 and min(map(len, pictures)) > 10_000
        page.locator("#show-voxels").uncheck()
        page.locator("#show-skeleton").uncheck()
        assert len(page.evaluate(seen)) < 0.5 * min(map(len, pictures))  # the floor alone
        assert "WebGL" not in page.locator("#player").inner_text()


def test_videos_are_made_to_fit(tmp_path: Path) -> None:
    """Those of other codecs and those that are too large are encoded anew, frame for frame."""
    small = noise_video(tmp_path / "small.mp4", 5, (320, 240))
    assert encode_page_video(small) == small.read_bytes()
    old = tmp_path / "old.mp4"
    footage.write_video(old, [90] * 7, size=(320, 240))
    (tmp_path / "new.mp4").write_bytes(encode_page_video(old))
    assert count_frames(tmp_path / "new.mp4") == 7
    assert encode_page_video(tmp_path / "new.mp4") == (tmp_path / "new.mp4").read_bytes()
    (tmp_path / "text.mp4").write_text("no video")
    with pytest.raises(InputError, match=r"text\.mp4: cannot be read as a video"):
        encode_page_video(tmp_path / "text.mp4")


def test_content_of_the_page_of_several(tmp_path: Path) -> None:
    (tmp_path / "person1").mkdir()
    (tmp_path / "person1" / "report.html").write_text("its own")
    write_page(tmp_path / PAGE, "a <walk>", tracks.pair(), tmp_path / "none.mp4")
    page = (tmp_path / PAGE).read_text()
    text = re.search(r'type="application/json">(.*?)</script>', page, re.S)
    assert text is not None
    content = json.loads(text[1])
    assert content["counts"] == [1, 1, 2, 2, 2, 1]
    one, two = content["people"]
    assert (one["page"], two["page"]) == ("person1/report.html", None)
    assert (two["verdict"], two["seen"], two["shown"]) == ("bad", "2-4", [0, 0, 1, 1, 1, 0])
    assert "1 more that moves is not followed" in content["lines"][1]


def test_people_are_switched_on_and_off(tmp_path: Path) -> None:
    path = tmp_path / PAGE
    write_page(path, "walk", tracks.pair(), tmp_path / "none.mp4")
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


def test_commands_take_all_people_or_say_why_not(tmp_path: Path) -> None:
    out = tmp_path / "out"
    both = tracks.pair()
    replace(both, tracks=(both[0], tracks.lose(both[1], [0, 1]))).save(out)
    said = succeed("apf", "export", out, "--to", "csv", "--raw", "-o", tmp_path / "files").out
    files = [tmp_path / "files" / f"person{k}" / "angles.csv" for k in (1, 2)]
    assert all(file.exists() for file in files)
    assert "the person was not there in frames 0-1" in said
    succeed("apf", "smooth", str(out), "-o", str(tmp_path / "smooth"))
    smooth = PeopleTracks.open(tmp_path / "smooth")
    assert [track.smoothing is not None for track in smooth] == [True, True]
    assert smooth.seen[1].tolist() == [2, 3, 4]
    said = fail("apf", "render", tmp_path, out, "-o", tmp_path / "pictures")
    assert "each picture is of one body; expected one's folder, as" in said


def test_folders_that_hold_no_track_of_a_body_say_what_they_hold(tmp_path: Path) -> None:
    for seed in (0, 1):
        tracks.walker(6).save(tmp_path / "seeds" / "person1" / f"seed{seed}" / "track.npz")
    track = tracks.walker(6)
    points = replace(track, body=None, dof_names=(), poses=track.poses[:, :0])
    points.save(tmp_path / "points" / "track.npz")
    for command, said in (
        (["export", "seeds"], f"2 runs; expected one, as {tmp_path}"),
        (["report", "points"], "triangulated points, which are not judged; expected the track of"),
        (["view", "points", "--png", "x.png"], "triangulated points have none"),
    ):
        assert said in fail("apf", command[0], str(tmp_path / command[1]), *command[2:])
    assert "no folder" in fail("apf", "report", tmp_path / "absent")
    tracks.walker().save(tmp_path / "track.npz")
    assert "summary.json: no such file" in fail("apf", "report", tmp_path)
    (tmp_path / "summary.json").write_text("{}")
    assert "summary.json: not the summary of an `apf track`" in fail("apf", "report", tmp_path)
