"""Which takes count as finished."""

import os
from pathlib import Path

import pytest

from apf.cluster.record import TakeRecord, describe_files, list_files


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
    assert TakeRecord.read(tmp_path) is None
    for text in ("", "[]", '{"version": 1}', '{"inputs": {"a": 3}}', '{"inputs": {"a": [1]}}'):
        (tmp_path / "take.json").write_text(text)
        assert TakeRecord.read(tmp_path) is None


def test_files_that_look_as_before_are_not_read_but_changed_or_gone_are_seen(take: Path) -> None:
    known = TakeRecord.describe_take(take, {})
    changed(take / "calibration.toml", "f = 7", same_time=True)
    assert TakeRecord.describe_take(take, {}, known).is_same_take(known)
    assert not TakeRecord.describe_take(take, {}).is_same_take(known)
    record = TakeRecord("0", {}, {}, {}, describe_files(take, list_files(take)))
    assert record.is_complete(take)
    changed(take / "calibration.toml", "f = 8")
    assert not record.is_complete(take)
    (take / "calibration.toml").unlink()
    assert not record.is_complete(take)
