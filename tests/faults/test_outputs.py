"""Output folders: the user's files stay, stale ones go, what is not whole says so."""

import multiprocessing
import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from cl import InputError
from psfs.common.files import write_atomically, write_text
from psfs.common.outputs import (
    MANIFEST,
    Manifest,
    find_unfinished_command,
    output_folder,
    temporary_name,
)


def run(out: Path, *names: str) -> None:
    with output_folder(out, "a run"):
        for name in names:
            write_text(out / name, "ours")


def refuse(said: str, out: Path, name: str = "a run", **settings: Any) -> None:
    """Assert that nothing can be written into a folder."""
    with pytest.raises(InputError, match=said), output_folder(out, name, **settings):
        pass


def files(out: Path) -> set[str]:
    return {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()}


def test_a_run_replaces_its_own_files_only(tmp_path: Path) -> None:
    run(tmp_path, "a.txt", "clouds/frame_000001.ply", "clouds/frame_000002.ply")
    with output_folder(tmp_path, "a check", addition=True):
        write_text(tmp_path / "check.json", "ours")
    (tmp_path / "clouds/frame_scan.ply").write_text("mine")
    (tmp_path / "notes.txt").write_text("mine")
    run(tmp_path, "b.txt")
    assert files(tmp_path) == {MANIFEST, "b.txt", "clouds/frame_scan.ply", "notes.txt"}
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_nothing_is_touched_before_the_first_result(tmp_path: Path) -> None:
    run(tmp_path, "a.txt")
    before = (tmp_path / MANIFEST).read_bytes()
    with pytest.raises(InputError, match="bad"), output_folder(tmp_path, "a run"):
        raise InputError("bad input")
    assert files(tmp_path) == {MANIFEST, "a.txt"} and (tmp_path / MANIFEST).read_bytes() == before


@pytest.mark.parametrize("manifest", [False, True])
def test_a_file_of_the_user_in_the_way(tmp_path: Path, manifest: bool) -> None:
    if manifest:
        run(tmp_path, "b.txt")
    (tmp_path / "a.txt").write_text("mine")
    with pytest.raises(InputError, match=r"a\.txt: is there already"):
        run(tmp_path, "a.txt")
    refuse(r"a\.txt: is there already", tmp_path, expected=["*.txt"])
    assert (tmp_path / "a.txt").read_text() == "mine"
    assert (tmp_path / "b.txt").exists() == manifest


def test_incomplete_first_and_whole_last(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), output_folder(tmp_path, "a run"):
        write_text(tmp_path / "a.txt", "ours")
        assert find_unfinished_command(tmp_path) == "a run"
        raise KeyboardInterrupt
    assert find_unfinished_command(tmp_path) == "a run" and (tmp_path / "a.txt").exists()
    with output_folder(tmp_path, "a check", addition=True):
        write_text(tmp_path / "check.json", "ours")
    assert find_unfinished_command(tmp_path) == "a run"
    run(tmp_path, "a.txt")
    assert find_unfinished_command(tmp_path) is None and files(tmp_path) == {MANIFEST, "a.txt"}


def test_additions_replace_those_of_the_same_command(tmp_path: Path) -> None:
    run(tmp_path, "a.txt")
    for name in ("x.csv", "x.json"):
        with output_folder(tmp_path, "evaluate", addition=True, replaces=True):
            write_text(tmp_path / name, "ours")
    assert files(tmp_path) == {MANIFEST, "a.txt", "x.json"}


def test_additions_to_a_part_of_a_run(tmp_path: Path) -> None:
    """As to the folder of one of several people: after an addition to all, and beside others."""
    run(tmp_path, "person1/a.txt", "person2/a.txt")
    for folder, names in (("", ["person1/x", "person2/x"]), ("person1", ["x"]), ("person2", ["y"])):
        with output_folder(tmp_path / folder, "evaluate", addition=True, replaces=True):
            for name in names:
                write_text(tmp_path / folder / name, "ours")
    own = {"person1/a.txt", "person2/a.txt", "person1/x", "person2/y"}
    assert files(tmp_path) == {MANIFEST, *own}
    run(tmp_path, "b.txt")
    assert files(tmp_path) == {MANIFEST, "b.txt"}


@pytest.mark.parametrize("inside", ["", "seq", "seq/videos"])
def test_an_output_over_the_input(tmp_path: Path, inside: str) -> None:
    (tmp_path / "seq/videos").mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / inside)
    for out in (tmp_path / inside, tmp_path / "link"):
        refuse("which is read", out, inputs=[tmp_path / "seq/videos"])
    with output_folder(tmp_path / "seq/out", "a run", inputs=[tmp_path / "seq/videos"]):
        pass


@pytest.mark.parametrize("by", ["nobody", "apf synth"])
def test_results_among_footage(tmp_path: Path, by: str) -> None:
    video = tmp_path / "videos" / "cam01.mp4"
    if by == "nobody":
        video.parent.mkdir()
        video.write_text("film")
    else:
        with output_folder(tmp_path, by):
            write_text(video, "ours")
    refuse(r"cam01\.mp4, which may be read", video.parent, "apf evaluate", addition=True)
    run(tmp_path / "new", "picture.png")
    with output_folder(tmp_path / "new", "apf evaluate", addition=True):
        write_text(tmp_path / "new" / "evaluation.png", "ours")


def test_leftovers_of_killed_processes_are_cleared(tmp_path: Path) -> None:
    process = multiprocessing.get_context("spawn").Process(target=int)
    process.start()
    process.join()
    run(tmp_path, "clouds/a.ply")
    mine = temporary_name(tmp_path / "mine.txt")
    mine.write_text("being written")
    for name in ("a.txt", "clouds/b.ply"):
        (tmp_path / name).with_name(f".psfs-{process.pid}-x.ply").write_text("half")
    run(tmp_path, "a.txt")
    assert files(tmp_path) == {MANIFEST, "a.txt", mine.name}


@pytest.mark.parametrize("name", ["../evil.txt", "/evil.txt", "a/../../evil.txt", "a\0b", ""])
def test_a_forged_manifest_removes_nothing_outside(tmp_path: Path, name: str) -> None:
    out = tmp_path / "out"
    run(out, "a.txt")
    evil = tmp_path / "evil.txt"
    evil.write_text("mine")
    with (out / MANIFEST).open("a") as file:
        file.write(f"file {name or evil}\nfile link/evil.txt\n")
    (out / "link").symlink_to(tmp_path)
    run(out, "a.txt")
    assert evil.read_text() == "mine"


def test_a_copy_of_a_file_that_is_gone(tmp_path: Path) -> None:
    """The blame is the source's; a file in a folder's place is named, too."""
    with (
        pytest.raises(InputError, match=r"gone\.png: no such file"),
        write_atomically(tmp_path / "new.png") as temporary,
    ):
        shutil.copyfile(tmp_path / "gone.png", temporary)
    (tmp_path / "a").write_text("mine")
    with pytest.raises(
        InputError, match=r"a/b\.txt: cannot be written: .*a is a file; expected a f"
    ):
        write_text(tmp_path / "a/b.txt", "ours")


def test_a_manifest_that_is_none_or_was_cut(tmp_path: Path) -> None:
    run(tmp_path, "a.txt")
    with (tmp_path / MANIFEST).open("a") as file:
        file.write("file b")  # killed while it was written
    assert set(Manifest.read(tmp_path).files) == {"a.txt"}
    (tmp_path / MANIFEST).write_text("psfs-ap")
    assert Manifest.read(tmp_path) == Manifest()
    (tmp_path / MANIFEST).write_text("my own list\n")
    with pytest.raises(InputError, match="not a manifest of psfs-apf"):
        run(tmp_path, "a.txt")
    assert (tmp_path / MANIFEST).read_text() == "my own list\n"


@pytest.mark.parametrize("begun", [False, True])
def test_two_runs_into_one_folder(tmp_path: Path, begun: bool) -> None:
    """The second is refused from the first moment of the first one."""
    with output_folder(tmp_path / "new", "a first run") as out:
        if begun:
            out.begin()
        context = multiprocessing.get_context("spawn")
        queue = context.Queue()
        process = context.Process(target=_second, args=(str(tmp_path / "new"), queue))
        process.start()
        said = queue.get(timeout=60)
        assert f"`a first run` (process {os.getpid()} on " in said and "is writing to it" in said
        process.join()
    assert (tmp_path / "new").exists() == begun


def _second(out: str, queue: multiprocessing.Queue) -> None:
    try:
        run(Path(out), "a.txt")
        queue.put("done")
    except InputError as error:
        queue.put(str(error))


@pytest.mark.parametrize("place", ["file", "file/out", "x" * 300])
def test_places_that_cannot_be_written(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("mine")
    refuse(place[:20], tmp_path / place)
    assert (tmp_path / "file").read_text() == "mine"
