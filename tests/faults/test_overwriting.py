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


@pytest.mark.parametrize("name", ["mine.png", "seq/masks/c3/0001.png"])
def test_a_picture_over_a_file(stock: Path, name: str) -> None:
    if name == "mine.png":
        (stock / name).write_bytes(b"mine")
    refused([*VIEW, "--png", name], stock, name)


def test_a_picture_among_the_masks(stock: Path) -> None:
    words = ["psfs", "info", "seq", "--masks", "seq/masks/c3/new.png"]
    refused(words, stock, "lies among the files that are read")


def test_silhouettes_as_the_true_masks(stock: Path) -> None:
    words = ["psfs", "silhouettes", "seq", "-o", "seq/truth_masks", "--frames", "0:1"]
    refused(words, stock, "seq/truth_masks", "which is read")


def test_a_picture_that_was_written_before(stock: Path) -> None:
    for _ in range(2):
        succeed(*VIEW, "--png", "x.png")
    (stock / "x.png").write_bytes(b"changed since")
    refused([*VIEW, "--png", "x.png"], stock, "x.png: exists", "--overwrite")
    succeed(*VIEW, "--png", "x.png", "--overwrite")
    assert (stock / "x.png").read_bytes() != b"changed since"


def test_a_link_over_a_file(stock: Path) -> None:
    (stock / "x.png").symlink_to("out/preview.png")
    refused([*VIEW, "--png", "x.png", "--overwrite"], stock, "no regular file")


def test_a_mesh_over_a_file(stock: Path) -> None:
    pytest.importorskip("skimage")
    (stock / "mine.ply").write_bytes(b"mine")
    refused(["psfs", "mesh", "out", "--frame", "1", "-o", "mine.ply"], stock, "mine.ply: exists")


def test_a_link_out_of_an_output(stock: Path) -> None:
    (stock / "elsewhere").mkdir()
    (stock / "new").mkdir()
    (stock / "new/videos").symlink_to(stock / "elsewhere")
    said = fail("psfs", "convert", "walk", "-o", "new")
    assert "a symbolic link leads out of new" in said
    assert not state(stock / "elsewhere")
