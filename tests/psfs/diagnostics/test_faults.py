"""Wrong footage is named: a walking block in masks, spoilt in one way each."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import footage, scenes
from helpers.commands import fail, succeed
from helpers.shared import shared_data

from cl import Device, InputError, NumpyDevice
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.units import scale_rig
from psfs.diagnostics.calibration_faults import find_rig_faults
from psfs.diagnostics.examination import Examination, diagnose
from psfs.diagnostics.fault import Fault
from psfs.diagnostics.picture_faults import _measure_shift
from psfs.sequence import Sequence
from psfs.session import Session
from psfs.volume import find_volume

FRAMES = 36
NAMES = [f"c{k}" for k in range(5)]


@pytest.fixture(scope="module")
def masks() -> np.ndarray:
    return film(rig())


def film(cameras: CameraRig, first: int = 0, beside: float = 0.0) -> np.ndarray:
    """(F, V, h, w) uint8: a block that walks, turns and bobs, past five cameras of one size, as
    from frame `first` on, and `beside` m to the side."""
    out = np.zeros((FRAMES, len(NAMES), 120, 160), np.uint8)
    heights = np.linspace(0.1, 1.7, 9)
    corners = np.stack(np.meshgrid([-0.3, 0.2], [-0.15, 0.15], heights), -1).reshape(-1, 3)
    for frame in range(FRAMES):
        now = frame + first
        turn = cv2.Rodrigues(np.array([0, 0, 0.12 * now]))[0]
        place = np.array([0.02 * (now - 18), 0.3 * np.sin(now / 5), 0.1 * np.sin(now / 2)])
        place[1] += beside
        for view, camera in enumerate(cameras):
            out[frame, view] = scenes.draw_hull(camera, corners @ turn.T + place)
    return out


def rig(aside: float = 0.0) -> CameraRig:
    """Five cameras around the block; aside: m by which they look past it, to either side."""
    cameras = []
    for k, name in enumerate(NAMES):
        angle = 1.1 * k + 0.3
        centre = np.array([3.2 * np.cos(angle), 3.2 * np.sin(angle), 1.0 + 0.4 * k])
        left = (-1) ** k * aside * np.array([-np.sin(angle), np.cos(angle), 0])
        looking = scenes.looking_at(name, centre, left + np.array([0, 0, 0.9]), (160, 120), 140.0)
        cameras.append(replace(looking, distortion=np.zeros(5)))
    return CameraRig(tuple(cameras))


def write(folder: Path, masks: np.ndarray, cameras: CameraRig | None = None) -> Path:
    footage.write_take(folder, cameras or rig(), masks.swapaxes(0, 1))
    (folder / "sequence.toml").write_text("fps = 30\n")
    return folder


def write_pictures(folder: Path, masks: np.ndarray) -> Path:
    """Write pictures in which the block, bright, stands before a textured room."""
    rng, views = np.random.default_rng(0), []
    for own in masks.swapaxes(0, 1):
        room = cv2.resize(rng.integers(30, 160, (12, 16, 3), np.uint8), (160, 120))
        shown = np.where(own[..., None] > 0, 220, room)
        shown = shown + rng.normal(0, 2, shown.shape)
        views.append(np.clip(shown, 0, 255).astype(np.uint8))
    return footage.write_take(folder, rig(), views, "images")


def test_one_picture_has_no_silhouette(tmp_path: Path, masks: np.ndarray) -> None:
    session = Session(Sequence.open(write_pictures(tmp_path / "one", masks[:1])), NumpyDevice())
    diagnosis = diagnose(session)
    (found,) = diagnosis.faults
    assert found.cameras == tuple(NAMES) and str(found).startswith("one picture of cameras c0, c1")
    assert "film the empty room" in str(found) and "--keypoints" in str(found)
    with pytest.raises(InputError, match=r"5 of 5 cameras.*film the empty room"):
        Examination(session, diagnosis).check_sight()
    many = faults(write_pictures(tmp_path / "many", masks[::9]))
    assert all(fault.kind != "empty" for fault in many), many


def faults(folder: Path, **settings) -> list[Fault]:
    return diagnose(Session(Sequence.open(folder, **settings), Device.best())).faults


def with_k1(k1: list[float]) -> CameraRig:
    lenses = [np.array([own, 0, 0, 0, 0]) for own in k1]
    cameras = zip(rig(aside=-0.5), lenses, strict=True)
    return CameraRig(tuple(replace(camera, distortion=lens) for camera, lens in cameras))


def test_dropped_distortion(tmp_path: Path) -> None:
    wide = film(with_k1([-0.35] * 5))
    (of_all,) = faults(write(tmp_path / "all", wide, with_k1([0.0] * 5)))
    assert of_all.kind == "lens" and not of_all.cameras
    assert "states no lens distortion, but silhouettes fit with k1 = -0." in of_all.text
    of_one = with_k1([-0.35, -0.35, 0.0, -0.35, -0.35])
    (fault,) = faults(write(tmp_path / "one", wide, of_one))
    assert fault.kind == "lens" and fault.cameras == ("c2",)
    assert faults(write(tmp_path / "rectified", film(of_one), of_one)) == []


#: Masks of some cameras, made of all (F, V, h, w), and the fault that is named.
SPOILT = {
    "exchanged": (lambda m: {1: m[:, 4], 4: m[:, 1]}, "exchange", ("c1", "c4"), "exchanged"),
    "hangs": (
        lambda m: {2: m[np.minimum(np.arange(FRAMES), FRAMES // 2), 2]},
        *("repeats", ("c2",), f"in frames 18 to {FRAMES - 1}"),
    ),
    "of another take": (
        lambda m: {2: m[7 * np.arange(FRAMES) % FRAMES, 4][:, ::-1]},
        *("disagrees", ("c2",), "another take"),
    ),
    "mirrored": (
        lambda m: {3: m[:, 3, :, ::-1]},
        *("flipped", ("c3",), "the pictures of camera c3 are mirrored"),
    ),
    "all mirrored": (
        lambda m: {v: m[:, v, :, ::-1] for v in range(5)},
        *("flipped", tuple(NAMES), "all cameras"),
    ),
    "upside down": (lambda m: {3: m[:, 3, ::-1, ::-1]}, "flipped", ("c3",), "180 degrees"),
    "shows nobody": (lambda m: {2: 0 * m[:, 2]}, "empty", ("c2",), "shows nobody"),
    "empty room": (lambda m: {v: 0 * m[:, v] for v in range(5)}, "empty", (), "nothing stands"),
}


@pytest.mark.parametrize("name", SPOILT)
def test_cameras_that_show_something_else(tmp_path: Path, masks: np.ndarray, name: str) -> None:
    spoil, kind, cameras, said = SPOILT[name]
    spoilt = masks.copy()
    for view, shown in spoil(masks).items():
        spoilt[:, view] = shown
    (fault,) = faults(write(tmp_path / "a", spoilt))
    assert (fault.kind, fault.cameras) == (kind, cameras)
    assert said in fault.text and "--sync" not in fault.text
    assert fault.spoils == (name in ("of another take", "shows nobody"))


def test_late_cameras_are_named_and_mended(tmp_path: Path, masks: np.ndarray) -> None:
    late, spoilt = -6, masks.copy()
    spoilt[:, 2] = np.roll(masks[:, 2], late, axis=0)
    folder = write(tmp_path / "a", spoilt[: FRAMES + late])
    diagnosis = diagnose(Session(Sequence.open(folder), NumpyDevice()))
    assert diagnosis.late == {"c2": late}
    assert "--sync auto" in str(diagnosis.faults[0]) and "c2" in str(diagnosis.faults[0])
    mended = Sequence.open(folder).synchronise(diagnosis.late)
    assert len(mended) == FRAMES - 2 * abs(late)
    assert diagnose(Session(mended, NumpyDevice())).faults == []
    shown = mended.read(0).masks
    assert shown is not None
    np.testing.assert_array_equal(shown > 0, masks[-late] > 0)


def test_sync_auto_is_applied_and_remembered(tmp_path: Path, masks: np.ndarray) -> None:
    spoilt = masks.copy()
    spoilt[8:, 1] = masks[:-8, 1]
    folder, out = write(tmp_path / "a", spoilt[8:]), tmp_path / "out"
    command = ["reconstruct", str(folder), "-o", str(out), "--voxel-size", "0.05"]
    said = succeed("psfs", *command, "--sync", "auto", "--no-colour", "--frames", "0:1").err
    assert "c1 +8" in said
    said = succeed("psfs", "check", out).out
    assert "late" not in said and "disagrees" not in said


def instead(camera: Camera) -> CameraRig:
    """Return the rig with another camera of the same name."""
    return CameraRig(tuple(camera if camera.name == c.name else c for c in rig()))


def test_centimetres_are_named_by_the_commands(tmp_path: Path, masks: np.ndarray) -> None:
    folder = write(tmp_path / "a", masks, scale_rig(rig(), 100))
    assert "--unit cm" in fail("apf", "track", folder, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert faults(folder, unit="cm") == [] and faults(folder, subject="object") == []


INVERSE = CameraRig(tuple(replace(c, R=c.R.T, t=-c.R.T @ c.t) for c in rig()))
#: Rigs that are not those of the masks, and the fault that is named.
WRONG_RIGS = {
    "centimetres": (scale_rig(rig(), 100), "unit", (), "--unit cm"),
    "inches": (scale_rig(rig(), 1 / 0.0254), "unit", (), "it looks like inches: --unit 0.0254"),
    "mm": (instead(replace(rig()[2], t=1000 * rig()[2].t)), "calibration", ("c2",), "c2 stan"),
    "camera to world": (INVERSE, "convention", (), "camera to the world"),
    "turned": (instead(scenes.turned(rig()[3], [0.02, 0.06, 0])), "disagrees", ("c3",), "3.6 deg"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG_RIGS)
def test_wrong_calibrations(tmp_path: Path, masks: np.ndarray, name: str) -> None:
    wrong, kind, cameras, said = WRONG_RIGS[name]
    (fault,) = faults(write(tmp_path / "a", masks, wrong))
    assert (fault.kind, fault.cameras) == (kind, cameras) and said in str(fault)


def test_leaving_a_camera_out_keeps_the_match_by_order(tmp_path: Path, masks: np.ndarray) -> None:
    folder = write(tmp_path / "a", masks[:4])
    for number, name in enumerate(NAMES):
        (folder / "masks" / name).rename(folder / "masks" / f"video{number}")
    sequence = Sequence.open(folder)
    assert any("video3 for c3" in note for note in sequence.notes)
    kept = sequence.with_cameras(["c0", "c3", "c4"]).read(2).masks
    assert kept is not None
    np.testing.assert_array_equal(kept > 0, masks[2, [0, 3, 4]] > 0)


def test_a_camera_behind_furniture_does_not_hang(tmp_path: Path, masks: np.ndarray) -> None:
    spoilt = masks.copy()
    top = np.flatnonzero(masks[:, 2].any((0, 2)))[0] + 2
    spoilt[:, 2, top:] = 0
    spoilt[FRAMES // 2 :, 2] = 0
    found = faults(write(tmp_path / "a", spoilt))
    assert all(fault.kind != "repeats" for fault in found)


def test_cameras_that_outline_different_people_are_of_one_take(tmp_path: Path) -> None:
    """Two blocks: each camera outlines the one that it shows larger."""
    alone = film(rig(), beside=-0.5)
    both = alone | film(rig(), first=40, beside=0.8)
    assert all(not fault.spoils for fault in faults(write(tmp_path / "a", both)))


def test_a_shift_is_measured_without_a_change_of_the_background() -> None:
    """OpenCV windows pictures of some sizes in place, which made a sound camera look knocked."""
    background = np.random.default_rng(0).random((240, 320)).astype(np.float32)
    before, window = background.copy(), cv2.createHanningWindow((320, 240), cv2.CV_32F)
    shift = _measure_shift(background, np.roll(background, 6, axis=1), window)
    assert shift == pytest.approx((6, 0), abs=0.5)
    np.testing.assert_array_equal(background, before)


def test_masks_of_other_values(tmp_path: Path, masks: np.ndarray) -> None:
    grey = write(tmp_path / "grey", masks[:4] // 3)
    (fault,) = faults(grey)
    assert fault.kind == "empty" and "(the greatest value in them is 85)" in fault.text
    with pytest.raises(InputError, match="the greatest value in them is 85"):
        find_volume(Session(Sequence.open(grey), NumpyDevice()))
    inverted = [f for f in faults(write(tmp_path / "inverted", 255 - masks[:4])) if f.serious]
    assert [fault.cameras for fault in inverted] == [(name,) for name in NAMES]
    assert all("black and white exchanged" in fault.text for fault in inverted)


def test_lenses_that_form_no_picture() -> None:
    """Coefficients of another unit fold the picture or squeeze it; pixels are no long strips, and
    no millimetres."""
    assert [*find_rig_faults(rig())] == []
    usual = np.array([-0.3, 0.1, 1e-3, -1e-3, 0.02])  # a wide lens
    assert [*find_rig_faults(instead(replace(rig()[0], distortion=usual)))] == []
    strips, skewed = rig()[0].K * np.array([[1.0], [10.0], [1.0]]), rig()[0].K.copy()
    skewed[0, 1] = 1e5
    in_mm = np.array([[6.0, 0, 80], [0, 6, 60], [0, 0, 1]])
    for changes, said in (
        ({"distortion": -5 * np.eye(5)[0]}, ""),
        ({"distortion": 1e5 * np.eye(5)[0]}, ""),
        ({"K": strips}, "about the same along both sides"),
        ({"K": skewed}, "about the same along both sides"),
        ({"K": in_mm}, "expected pixels, not mm"),
    ):
        (fault,) = find_rig_faults(instead(replace(rig()[0], **changes)))
        assert fault.kind == "calibration" and said in str(fault)


def test_poor_silhouettes_are_told_from_a_calibration(tmp_path: Path, masks: np.ndarray) -> None:
    noise = np.random.default_rng(0).random((12, 5, 12, 16)) < 0.3
    speckled = np.uint8(255) * noise.repeat(10, 2).repeat(10, 3)
    fault = faults(write(tmp_path / "a", speckled))[0]
    assert fault.kind == "disagrees" and "silhouettes are poor" in str(fault)
    elsewhere = CameraRig(
        tuple(
            replace(c, K=np.add(c.K, [[0, 0, 55 * (-1) ** k], [0, 0, 40], [0, 0, 0]]))
            for k, c in enumerate(rig())
        )
    )
    folder, sheet = write(tmp_path / "b", masks, elsewhere), tmp_path / "sheet.png"
    said = succeed("psfs", "info", folder, "--masks", sheet).out
    assert "the calibration is not of these pictures" in said
    picture = cv2.imread(str(sheet))
    assert picture is not None and picture.shape == (5 * 122, 6 * 162, 3)


def test_untouched_recordings_have_no_faults(device) -> None:
    found = diagnose(Session(Sequence.open(shared_data("dancer8")), device)).faults
    assert [str(fault) for fault in found if fault.serious] == []
