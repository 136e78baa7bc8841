"""Without pictures of the empty scene, the background is the median of the frames."""

import shutil
from pathlib import Path

import cv2
import numpy as np
from helpers import footage
from helpers.commands import fail, succeed
from scipy import ndimage

import psfs
from psfs.sequence import Sequence


def reconstructed(folder: Path) -> np.ndarray:
    box = np.array([[-1.5, -1.5, 0], [1.5, 1.5, 2]])
    few: dict = {"frames": slice(6, 7), "volume": box, "voxel_size": 0.04, "all_cameras": True}
    (cloud,) = psfs.reconstruct(psfs.open_sequence(folder), colour=False, **few)
    solid = np.zeros(cloud.grid.shape, bool)
    solid.flat[cloud.indices] = True
    return np.asarray(ndimage.binary_fill_holes(solid))


def test_a_moving_person_is_found(slow_walk: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare"
    shutil.copytree(slow_walk, bare)
    shutil.rmtree(bare / "background")
    assert Sequence.open(bare).background_kind == "frames"
    with_plate, without = reconstructed(slow_walk), reconstructed(bare)
    assert (with_plate & without).sum() > 0.7 * (with_plate | without).sum()


def test_a_still_person_is_background(slow_walk: Path, tmp_path: Path) -> None:
    still, sequence = tmp_path / "still", Sequence.open(slow_walk)
    images = sequence.read(5).images
    assert images is not None
    footage.write_take(still, sequence.rig, [4 * [image] for image in images], "images")
    last = fail("psfs", "reconstruct", still, "-o", tmp_path / "out").strip().splitlines()[-1]
    assert "expected a person who moves" in last and "background/" in last


def test_a_background_that_holds_the_person_is_found_out(slow_walk: Path, tmp_path: Path) -> None:
    """In one camera's film."""
    plate = shutil.copytree(slow_walk, tmp_path / "plate")
    (plate / "background/cam02.mp4").unlink()
    images = Sequence.open(slow_walk).read(0).images
    assert images is not None
    cv2.imwrite(str(plate / "background/cam02.png"), images[1])
    said = " ".join(succeed("psfs", "info", plate).out.split())
    assert "one person is seen" in said and "camera cam" not in said
