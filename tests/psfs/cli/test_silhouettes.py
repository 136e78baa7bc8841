"""`psfs silhouettes`: pictures of the silhouettes, and how far they agree with true masks."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.commands import run, succeed

import psfs.cli.silhouettes as command
from cl import Device
from psfs.diagnostics.mask_scores import score_silhouettes
from psfs.reconstructor import Reconstructor
from psfs.sequence import Sequence
from psfs.session import Session
from psfs.volume import automatic_grid


@pytest.fixture(scope="module")
def folder(small_walk: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four frames of a walk; true masks of frame 0, and of frame 2 as far as the test writes them:
    of cam01 and cam02 what is seen of them in frame 0, moved by 3 px."""
    folder = Path(shutil.copytree(small_walk, tmp_path_factory.mktemp("silhouettes") / "walk"))
    masks = folder / "truth_masks"
    for name in ("cam01", "cam02"):
        mask = cv2.imread(str(masks / f"{name}_000000.png"), cv2.IMREAD_GRAYSCALE)
        cv2.imwrite(str(masks / f"{name}_000002.png"), np.roll(mask, 3, axis=1))
    cv2.imwrite(str(masks / "cam09_000001.png"), np.zeros((120, 160), np.uint8))  # no such camera
    return folder


def show(folder: Path, out: Path, *flags: str) -> list[str]:
    return ["psfs", "silhouettes", str(folder), "-o", str(out), *flags]


def test_frames_with_true_masks_are_shown(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    printed = succeed(*show(folder, out)).out
    pictures = sorted(path.name for path in out.glob("*.png"))
    assert pictures == ["frame_000000.png", "frame_000002.png"]
    report = json.loads((out / "silhouettes.json").read_text())
    first, third = report["frames"]["0"], report["frames"]["2"]
    assert min(first["iou"]) > 0.7 and third["iou"][2:] == [None, None]
    assert max(third["iou"][:2]) < min(first["iou"][:2])  # the masks were moved
    assert all(0 < share < 0.5 for share in third["foreground"])
    camera = report["cameras"]["cam01"]
    assert camera["mean_iou"] == pytest.approx((first["iou"][0] + third["iou"][0]) / 2, abs=1e-4)
    assert camera["worst_iou"] == third["iou"][0]
    known = [value for of in (first, third) for value in of["iou"] if value is not None]
    assert report["mean_iou"] == pytest.approx(np.mean(known), abs=1e-4)
    assert "mean IoU" in printed and "cam04" in printed
    # Four panels a row, one row a camera.
    height, width = cv2.imread(str(out / "frame_000000.png")).shape[:2]
    assert height > 4 * 200 and width > 4 * 100


def test_without_true_masks_frames_are_spread(folder: Path, tmp_path: Path) -> None:
    bare = shutil.copytree(folder, tmp_path / "walk", ignore=shutil.ignore_patterns("truth*"))
    out = tmp_path / "out"
    printed = succeed(*show(bare, out)).out
    report = json.loads((out / "silhouettes.json").read_text())
    assert list(report["frames"]) == ["0", "1", "2", "3"]
    assert report["mean_iou"] is None and report["cameras"]["cam01"]["mean_foreground"] > 0
    assert "share of the picture" in printed and "IoU" not in printed


def test_the_silhouettes_are_those_of_the_reconstruction(folder: Path, device: Device) -> None:
    """Those of frame 2, after the frames before have taught what they teach."""
    sequence = Sequence.open(folder)
    session = Session(sequence, device)
    grid = automatic_grid(session)
    reconstruct = Reconstructor(device, sequence.rig, grid, sequence.background)
    for frame in sequence.frames(slice(3)):
        reconstruct(frame)
    evidence = reconstruct.evidence()
    first, second, third = score_silhouettes(session, [2])
    assert first is None and second is None and third is not None
    np.testing.assert_array_equal(third.masks, (evidence > 0) & third.region)
    np.testing.assert_array_equal(third.likelihood > 0.5, evidence > 0)
    assert 0 < third.likelihood.min() < third.likelihood.max() < 1


def test_an_interrupt_keeps_what_was_shown(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, out = command.draw_mosaic, tmp_path / "out"

    def interrupted(rig, shown):
        if shown.frame.index == 2:
            raise KeyboardInterrupt
        return whole(rig, shown)

    monkeypatch.setattr(command, "draw_mosaic", interrupted)
    assert run(*show(folder, out)).code == 130
    assert list(json.loads((out / "silhouettes.json").read_text())["frames"]) == ["0"]
