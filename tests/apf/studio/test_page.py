"""The page: what it may open, and what it shows of a folder, in the server and in a browser."""

import io
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import tracks
from helpers.browser import browser
from helpers.studio import save_track, save_voxels

pytest.importorskip("viser", reason="viser is not installed")

from apf.report.drawing import PEOPLE
from apf.studio.folders import Roots, find_kind
from apf.studio.page import Page
from apf.tracking.people import PeopleTracks
from cl import Device, InputError, MissingFileError
from psfs.common.files import write_json
from psfs.page.watch import Watch
from psfs.page.words import make_lines, make_table, make_text

NAME = "<img src=x onerror=alert(1)>"


def no_device() -> Device:
    raise AssertionError("nothing here computes")


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Page]:
    made = Page(Roots(tmp_path), no_device)
    yield made
    made.stop()


def watch_in(page: Page, folder: Path) -> Any:
    """Open a folder, and return what shows it."""
    page.open(folder)
    assert isinstance(page.view, Watch)
    return page.view


def test_texts_are_shown_as_they_are() -> None:
    for made in (make_text(NAME), make_table([[NAME]], [NAME]), make_lines([("note", NAME)])):
        assert "<img" not in made and "&lt;img" in made


def test_body_stands_where_the_track_has_it(tmp_path: Path, page: Page) -> None:
    watch, track = watch_in(page, save_track(tmp_path / NAME)), tracks.walker()
    assert page.step == "Check"
    watch.time_line.seek(12)
    body = watch.bodies[NAME]
    assert np.allclose(body.joints.points, track.joints[12], atol=1e-5)
    assert np.allclose(body.skeleton.points, track.joints[12][track.edges], atol=1e-5)
    assert body.trails.points.shape == (12 * len(set(body.ends)), 2, 3)
    said = watch.status.content + watch.remarks.content
    assert "frame 12" in said and "<img" not in said
    with pytest.raises(InputError, match="outside of the folders"):
        page.open(tmp_path.parent)


def test_lost_person_and_limbs_are_named(tmp_path: Path, page: Page) -> None:
    sure = np.ones((10, 4))
    sure[3, 0] = 0.0
    known = {"lost": np.arange(10) == 5, "limb_confidence": sure}
    replace(tracks.walker(10), diagnostics=known).save(tmp_path / "run" / "track.npz")
    watch = watch_in(page, tmp_path / "run")
    watch.time_line.seek(3)
    assert "doubtful" in watch.status.content
    watch.time_line.seek(5)
    assert "the person is lost" in watch.status.content
    tracks.walker(6).save(tmp_path / "running" / "parts" / "track_000000000.npz")
    assert len(watch_in(page, tmp_path / "running").opened.frames) == 6


def test_keys_and_buttons_move_the_time_line(tmp_path: Path, page: Page) -> None:
    watch = watch_in(page, save_voxels(tmp_path / "voxels", n_frames=5))
    line = watch.time_line
    commands = {key: do for _, key, do in line.list_keys()}

    def press(*keys: str) -> tuple[int, str, str]:
        for key in keys:
            commands[key]()
        return line.position, line.speeds.value, line.button.label

    assert press("L", "L", "J") == (1, "1", "play") and line.slider.value == 1
    assert press("end", "pagedown") == (4, "0.5", "play")
    assert press("space")[2] == "pause" and line.playing
    assert press("home") == (0, "0.5", "play") and not line.playing
    assert "no pictures" in watch.remarks.content  # its footage is gone
    (tmp_path / "voxels" / "clouds" / "frame_000003.npz").write_bytes(b"damaged")
    line.seek(3)
    assert "no voxels of frame 3" in watch.remarks.content and line.position == 3


def test_what_a_browser_sends_for_a_file_is_one_of_the_options(tmp_path: Path, page: Page) -> None:
    """Not a path to somewhere else. A file that has another beside it is packed with it."""
    folder = save_track(tmp_path / "runs" / "walk")
    page.open(folder)
    for field in (page.export.ending, page.export.person):
        before, field.value = field.value, "/../../../out.bvh"
        with pytest.raises(InputError, match="expected one of"):
            page.export.make_file()
        field.value = before
    assert not (tmp_path / "out.bvh").exists()
    assert page.export.make_file()[0] == "walk.bvh"
    with pytest.raises(FileNotFoundError) as gone:
        page.export.read_report()
    page.say(gone.value)
    said = page._message.content
    assert "report.html: cannot be read or written: No such file" in said and "Errno" not in said
    tracks.lose(tracks.walker(), np.arange(26, 30)).save(folder / "track.npz")
    page.open(folder)
    page.export.ending.value = ".mot"
    name, content = page.export.make_file()
    with zipfile.ZipFile(io.BytesIO(content)) as packed:
        assert name == "walk.zip" and set(packed.namelist()) == {"walk.mot", "walk_filled.csv"}


def test_several_people_are_shown_together(tmp_path: Path, page: Page) -> None:
    both = tracks.walker(30), tracks.walker(30, 20)
    seen = np.arange(30), np.r_[20:42, 45:50]  # the second one is away for three frames
    PeopleTracks(both, np.arange(50), seen).save(tmp_path / "duo")
    gone = {"absolute": str(tmp_path / "gone"), "overrides": {}}
    facts = {"sequence": gone, "config": {}, "warnings": [], "people": 2}
    for k, says in ((1, ["the track looks good"]), (2, ["the track looks bad"])):
        quality = {"look_at": {"left arm": [[k, k + 1]]}}
        path = tmp_path / "duo" / f"person{k}" / "summary.json"
        write_json(path, {**facts, "says": says, "quality": quality})
    assert [one.name for one in page.roots.find()] == ["duo", "duo/person1", "duo/person2"]
    watch = watch_in(page, tmp_path / "duo")
    assert watch.opened.frames.tolist() == list(range(50))
    watch.time_line.seek(25)
    for name, row in (("person1", 25), ("person2", 5)):
        joints = watch.bodies[name].joints.points
        assert np.allclose(joints, tracks.walker(30).joints[row], atol=1e-5)
    watch.time_line.seek(40)
    assert "person1: not tracked in this frame" in watch.status.content
    shown = [page.server.scene.get_handle_by_name(f"/people/{n}").visible for n in (0, 1)]
    assert shown == [False, True]
    watch.time_line.seek(43)
    assert "person2: not tracked in this frame" in watch.status.content
    assert watch.opened.quality[1] == "person2: the track looks bad"
    assert watch.opened.look_at["person2: left arm"].tolist() == [2, 3]
    colours = [watch.bodies[name].cones[0].color for name in ("person1", "person2")]
    assert colours == list(PEOPLE[:2])
    assert page.correct.move_button.disabled  # corrections are of one person
    page.open(tmp_path / "duo" / "person1")
    assert page.correct.move_button.disabled  # whose silhouettes are not separated again


def test_page_in_a_browser(tmp_path: Path, page: Page) -> None:
    page.open(save_track(tmp_path / NAME))
    with browser() as chromium:
        tab = chromium.new_page(viewport={"width": 400, "height": 300})
        tab.set_default_timeout(120_000)  # a machine under load
        asked: list[str] = []
        alerts: list[Any] = []
        tab.on("request", lambda request: asked.append(request.url))
        tab.on("dialog", lambda dialog: (alerts.append(dialog), dialog.dismiss()))
        tab.goto(page.address)
        tab.get_by_text("frame 0 ·").wait_for()
        tab.keyboard.press("l")
        tab.get_by_text("frame 1 ·").wait_for()
        assert tab.get_by_text(NAME).count() > 0  # as text
        assert alerts == []
    own = page.address.rpartition("/")[0]
    assert all(url.startswith((own, "blob:", "data:")) for url in asked)


def test_folders_are_found_by_their_kind(tmp_path: Path) -> None:
    save_track(tmp_path / "a" / "track")
    save_voxels(tmp_path / "voxels")
    take = tmp_path / "take"
    take.mkdir()
    for folder in (take, tmp_path / "other"):  # the other one has cameras alone
        folder.mkdir(exist_ok=True)
        (folder / "calibration.toml").write_text("")
    for name in ("cam1.mp4", "cam2.mp4"):
        (take / name).touch()
    found = {one.name: one.kind for one in Roots(tmp_path).find()}
    assert found == {"a/track": "track", "take": "take", "voxels": "voxels"}
    assert find_kind(tmp_path / "other") is None


def test_nothing_outside_is_opened(tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    secret = save_track(tmp_path / "secret")
    (inside / "link").symlink_to(secret)
    roots = Roots(inside)
    assert roots.find() == []
    for path in (secret, inside / ".." / "secret", inside / "link", Path("/etc")):
        with pytest.raises(InputError, match="outside of the folders"):
            roots.check(path)
    assert roots.check(inside / "later") == inside.resolve() / "later"
    with pytest.raises(MissingFileError):
        Roots(tmp_path / "gone")
