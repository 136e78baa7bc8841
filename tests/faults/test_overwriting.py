"""Files and folders of the user's in the place of an output: they stay as they are."""

from pathlib import Path

import pytest
from helpers.commands import fail, succeed
from helpers.faults import refused, state

VIEW = ["psfs", "view", "out", "--frame", "1"]


@pytest.fixture
def stock(stock: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(stock.parent / "cache"))
    return stock


#: Words, and what the line says.
REFUSED = {
    "psfs view out --frame 1 --png mine.png": ["mine.png"],
    "psfs view out --frame 1 --png seq/masks/c3/0001.png": ["seq/masks/c3/0001.png"],
    "psfs view out --frame 1 --png link.png --overwrite": ["no regular file"],
    "psfs info seq --masks seq/masks/c3/new.png": ["lies among the files that are read"],
    "psfs silhouettes seq -o seq/truth_masks --frames 0:1": ["seq/truth_masks", "which is read"],
    "psfs mesh out --frame 1 -o mine.ply": ["mine.ply: exists"],
}


@pytest.mark.parametrize("words", REFUSED)
def test_files_that_stay(stock: Path, words: str) -> None:
    for name in ("mine.png", "mine.ply"):
        (stock / name).write_bytes(b"mine")
    (stock / "link.png").symlink_to("out/preview.png")
    refused(words.split(), stock, *REFUSED[words])


def test_a_picture_that_was_written_before(stock: Path) -> None:
    for _ in range(2):
        succeed(*VIEW, "--png", "x.png")
    (stock / "x.png").write_bytes(b"changed since")
    refused([*VIEW, "--png", "x.png"], stock, "x.png: exists", "--overwrite")
    succeed(*VIEW, "--png", "x.png", "--overwrite")
    assert (stock / "x.png").read_bytes() != b"changed since"


def test_a_link_out_of_an_output(stock: Path) -> None:
    (stock / "elsewhere").mkdir()
    (stock / "new").mkdir()
    (stock / "new/videos").symlink_to(stock / "elsewhere")
    said = fail("psfs", "convert", "walk", "-o", "new")
    assert "a symbolic link leads out of new" in said
    assert not state(stock / "elsewhere")
