"""Which takes count as finished; folders of results are complete or absent."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from apf.cluster.record import FileFacts, TakeRecord, list_files
from apf.cluster.whole_folder import clear_partial, replace_folder, replace_temporary_names
from cl import InputError
from psfs.common.files import write_atomically
from psfs.common.outputs import output_folder


@pytest.fixture
def take(tmp_path: Path) -> Path:
    folder = tmp_path / "take"
    (folder / "videos").mkdir(parents=True)
    (folder / "videos" / "cam01.mp4").write_bytes(b"a video")
    (folder / "calibration.toml").write_text("f = 1")
    (folder / ".thumbs").write_text("an editor's")
    return folder


def changed(path: Path, text: str, same_time: bool = False) -> None:
    before = path.stat()
    path.write_text(text)
    if same_time:
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def test_a_take_is_the_same_by_content_and_settings(take: Path, tmp_path: Path) -> None:
    body = tmp_path / "body.toml"
    body.write_text("a body")
    settings = {"seed": 1, "frames": slice(0, 4, None), "body": str(body), "device": "cpu"}
    first = TakeRecord.describe_take(take, settings)
    assert set(first.inputs) == {"videos/cam01.mp4", "calibration.toml"}
    assert set(first.files) == {"body"}
    (tmp_path / "out").mkdir()
    first.write(tmp_path / "out")
    read = TakeRecord.read(tmp_path / "out")
    assert read == first and read is not None

    moved = tmp_path / "elsewhere"
    take.rename(moved)
    os.utime(moved / "calibration.toml", ns=(1, 1))
    body.rename(tmp_path / "another.toml")
    renamed = settings | {"body": str(tmp_path / "another.toml")}
    assert TakeRecord.describe_take(moved, renamed).is_same_take(read)
    assert TakeRecord.describe_take(moved, renamed, read).is_same_take(read)

    assert not TakeRecord.describe_take(moved, renamed | {"seed": 2}).is_same_take(read)
    changed(tmp_path / "another.toml", "another body")
    assert not TakeRecord.describe_take(moved, renamed, read).is_same_take(read)
    changed(tmp_path / "another.toml", "a body")
    changed(moved / "calibration.toml", "f = 2")
    assert not TakeRecord.describe_take(moved, renamed, read).is_same_take(read)
    changed(moved / "calibration.toml", "f = 1")
    (moved / "videos" / "cam02.mp4").write_bytes(b"")
    assert not TakeRecord.describe_take(moved, renamed, read).is_same_take(read)


def test_files_that_look_as_before_are_not_read(take: Path) -> None:
    known = TakeRecord.describe_take(take, {})
    changed(take / "calibration.toml", "f = 7", same_time=True)
    assert TakeRecord.describe_take(take, {}, known).is_same_take(known)
    assert not TakeRecord.describe_take(take, {}).is_same_take(known)


@pytest.mark.parametrize("damage", ["changed", "gone"])
def test_results_that_are_not_all_there(damage: str, take: Path) -> None:
    outputs = {str(p.relative_to(take)): FileFacts.read(p) for p in list_files(take)}
    record = TakeRecord("0", {}, {}, {}, outputs)
    assert record.is_complete(take)
    if damage == "gone":
        (take / "calibration.toml").unlink()
    else:
        changed(take / "calibration.toml", "f = 8")
    assert not record.is_complete(take)


@pytest.mark.parametrize("text", ["", "[]", '{"version": 1}', '{"inputs": {"a": 3}}'])
def test_no_record(text: str, tmp_path: Path) -> None:
    assert TakeRecord.read(tmp_path) is None
    (tmp_path / "take.json").write_text(text)
    assert TakeRecord.read(tmp_path) is None


def test_no_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="absent: no such folder"):
        TakeRecord.describe_take(tmp_path / "absent", {})


def test_temporary_names_in_sentences() -> None:
    partial = ".a walk.partial-host-12-0123abcd"
    for before in ("0.5 s: ", "/out/", "D:\\takes v1.2\\", "'"):
        text = replace_temporary_names(f"{before}{partial}/x.npz: bad")
        assert text == f"{before}a walk/x.npz: bad"


def test_a_folder_is_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "walk"
    for text in ("first", "second"):
        with replace_folder(path) as partial, output_folder(partial, "test"):
            with write_atomically(partial / text) as temporary:
                temporary.write_text(text)
            assert replace_temporary_names(f"{partial / text}: bad") == f"{path / text}: bad"
        assert {p.name for p in path.iterdir()} == {text, "manifest.txt"}
    with pytest.raises(KeyboardInterrupt), replace_folder(path) as partial:
        (partial / "third").write_text("third")
        raise KeyboardInterrupt
    assert {p.name for p in path.iterdir()} == {"second", "manifest.txt"}
    assert [p.name for p in tmp_path.iterdir()] == ["walk"]


def test_files_of_others_stay(tmp_path: Path) -> None:
    path = tmp_path / "walk"

    def written(text: str) -> None:
        with (
            replace_folder(path) as partial,
            output_folder(partial, "test"),
            write_atomically(partial / "a" / "track.npz") as temporary,
        ):
            temporary.write_text(text)

    written("first")
    (path / "a" / "notes.txt").write_text("mine")
    written("second")
    assert (path / "a" / "notes.txt").read_text() == "mine"
    assert (path / "a" / "track.npz").read_text() == "second"
    (path / "manifest.txt").unlink()
    with pytest.raises(InputError, match=r"track\.npz: is there already"):
        written("third")
    assert (path / "a" / "track.npz").read_text() == "second"
    assert [p.name for p in tmp_path.iterdir()] == ["walk"]


def test_leftovers_of_the_dead_are_cleared(tmp_path: Path) -> None:
    """Those of other takes, other hosts or running processes stay."""
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    here = platform.node()
    names = [
        f".walk.partial-{here}-{dead.pid}-0123abcd",
        f".walk.partial-{here}-{dead.pid}-0123abcd.old",
        f".walk.partial-{here}-{os.getpid()}-0123abcd",
        f".walk.partial-another-{dead.pid}-0123abcd",
        f".walk2.partial-{here}-{dead.pid}-0123abcd",
        ".walk.partial-notes",
    ]
    for name in names:
        (tmp_path / name).mkdir()
    (tmp_path / names[1] / "older").write_text("")
    clear_partial(tmp_path / "walk")
    assert {p.name for p in tmp_path.iterdir()} == {"walk", *names[2:]}
    assert (tmp_path / "walk" / "older").is_file()  # killed before the new one had its name
    clear_partial(tmp_path / "walk", of_all=True)
    assert {p.name for p in tmp_path.iterdir()} == {"walk", *names[4:]}
