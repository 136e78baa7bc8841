"""Cameras that disagree with the others are named, with the likely reason."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from helpers import footage, scenes
from helpers.commands import succeed
from helpers.shared import shared_data

import psfs
from cl import Device
from psfs.diagnostics.agreement import HullAgreement
from psfs.diagnostics.arrangement_faults import find_outlier
from psfs.diagnostics.examination import diagnose
from psfs.diagnostics.fault import significant
from psfs.sequence import Sequence
from psfs.session import Session


@pytest.fixture(scope="module")
def late_walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Masks of a block that walks past six cameras, c2 ten frames late."""
    rig, views = scenes.ring(6, size=(160, 120)), []
    for camera in rig:
        frames = np.arange(30)
        times = np.maximum(0, frames - 10) if camera.name == "c2" else frames
        shifts = [np.array([0.06 * (time - 15), 0, 0]) for time in times]
        views.append([scenes.draw_hull(camera, scenes.BLOCK + shift) for shift in shifts])
    return footage.write_take(tmp_path_factory.mktemp("late") / "walk", rig, views)


@pytest.mark.parametrize(
    ("kind", "reason"), [("noise", "looks like foreground"), ("black", "of one brightness")]
)
def test_a_spoilt_camera_is_named(
    slow_walk: Path, tmp_path: Path, device: Device, kind: str, reason: str
) -> None:
    """It is left out, and no sound camera with it."""
    walk = Sequence.open(slow_walk)
    views = np.stack([frame.images for frame in walk], axis=1)
    views[2] = np.random.default_rng(0).integers(0, 256, views[2].shape) * (kind == "noise")
    spoilt = footage.write_take(tmp_path / "spoilt", walk.rig, views, "images")
    shutil.copytree(slow_walk / "background", spoilt / "background")
    found = diagnose(Session(Sequence.open(spoilt), device))
    assert {f.cameras for f in found.faults if f.serious} == {("cam03",)}
    assert reason in found.faults[0].text
    assert len(found.left_out) == 1


def test_sound_cameras_are_not_named(device, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the first 12 frames."""
    monkeypatch.setattr("psfs.background.take._LONGEST_SIDE", 160)
    monkeypatch.setattr(Sequence, "__len__", lambda _: 12)
    faults = diagnose(Session(Sequence.open(shared_data("utrecht_seated")), device)).faults
    assert [str(fault) for fault in faults if fault.serious] == []


def test_clutter_and_furniture_accuse_no_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rafters across one picture, which touch the head, and a table before the legs in another."""
    monkeypatch.setattr("psfs.diagnostics.agreement._VOXELS", 150_000)
    rig, plain, blocks = scenes.ring(6, size=(160, 120)), [], []
    for frame in range(12):
        masks = np.zeros((6, 120, 160), np.uint8)
        for mask, camera in zip(masks, rig, strict=True):
            silhouette = scenes.draw_hull(camera, scenes.BLOCK + np.array([0.05 * frame, 0, 0]), 1)
            mask[: camera.size[1], : camera.size[0]] = silhouette
        plain.append(masks > 0)
        top = int(np.flatnonzero(masks[1].any(1))[0])
        masks[1, top - 3 : top + 3] = 1
        masks[2, top + 40 :] = 0
        blocks.append(masks > 0)
    measured = HullAgreement(rig, np.stack(blocks)).measure(range(6))
    number, gains = find_outlier(measured)
    assert not significant(gains, np.log(2), 1e-3)
    moved = np.stack(plain)
    moved[:, 4] = np.roll(moved[:, 4], 12, axis=-1)
    number, gains = find_outlier(HullAgreement(rig, moved).measure(range(6)))
    assert number == 4 and significant(gains, np.log(2), 1e-3)


def test_a_late_camera_is_named(late_walk: Path, tmp_path: Path) -> None:
    """One of six masks stands 10 frames behind, and is used because all are wanted."""
    folder = late_walk
    assert "camera c2 disagrees" in succeed("psfs", "info", folder).out
    out = tmp_path / "out"
    flags = ["--voxel-size", "0.08", "--frames", "20:21", "--all-cameras"]
    succeed("psfs", "reconstruct", folder, "-o", out, *flags)
    summary = json.loads((out / "summary.json").read_text())
    assert len(summary["sequence"]["cameras"]) == 6
    assert "camera c2 disagrees" in succeed("psfs", "check", out).out
    assert list(json.loads((out / "check.json").read_text())["disagreeing"]) == ["c2"]


def test_the_library_leaves_it_out_too(late_walk: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = late_walk
    few: dict = {"frames": slice(20, 21), "voxel_size": 0.08}
    (without,) = psfs.reconstruct(psfs.open_sequence(folder), **few)
    assert "left out: camera c2 disagrees" in caplog.text
    caplog.clear()
    names = psfs.open_sequence(folder).rig.names
    for sequence, everyone in (
        (psfs.open_sequence(folder), True),
        (psfs.open_sequence(folder, cameras=names), False),  # stated cameras are kept
    ):
        (cloud,) = psfs.reconstruct(sequence, all_cameras=everyone, **few)
        assert without.volume > cloud.volume and "left out" not in caplog.text
