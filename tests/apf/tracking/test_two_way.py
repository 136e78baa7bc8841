"""Tracks that are made forward and back."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.walkers import surface_voxels, walker

from apf.body.kinematics import posed_joints
from apf.body.limbs import limb_masks, limb_names
from apf.body.model import BodyModel
from apf.body.toml import load_body
from apf.filters.base import Estimate
from apf.initialisation.kept_voxels import RestoredVoxels, crop_voxels
from apf.reference.likelihood.voxel import uncrop
from apf.tracking.limb_confidence import LEAST_DISTANCE, SAME_PLACE
from apf.tracking.two_way import TwoWays, fuse_passes, smooth_poses
from cl import Device, DeviceError, InputError, NumpyDevice

BODY = load_body("song31")
RIGHT_ARM = limb_names(BODY).index("right arm")
ARM = BODY.dof_names.index("r_upper_arm.rx")


def estimate(pose: np.ndarray, lost: bool = False, body: BodyModel = BODY) -> Estimate:
    ones = np.ones(2)
    return Estimate(body, pose, np.full(body.n_dof, 0.02), ones, ones, ones, lost=lost)


moved = partial(bodies.bent, BODY)


def together(ahead: np.ndarray, behind: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Return the poses that two ways which stay where they are have together."""
    found = fuse_passes(len(errors) * [[estimate(ahead), estimate(behind)]], errors)
    return np.stack([one.pose for one in found])


def test_the_mean_is_of_the_ways_that_agree() -> None:
    """Of four, the one that has an arm elsewhere counts for the rest of the body alone."""
    rest = BODY.rest_pose
    bends = (0.1, -0.1, 0.06, -0.06)
    ways = [moved(rest, r_forearm__ry=bend, l_forearm__ry=bend) for bend in bends]
    ways[3] = moved(rest, r_upper_arm__rx=-1.2, l_forearm__ry=bends[3])
    found = fuse_passes(5 * [[estimate(way) for way in ways]], np.zeros((5, 4)))
    expected = moved(rest, r_forearm__ry=0.02)
    np.testing.assert_allclose([one.pose for one in found], 5 * [expected], atol=1e-12)
    arm = limb_masks(BODY)[RIGHT_ARM]
    np.testing.assert_allclose(found[2].deviation[arm], 0.02 / np.sqrt(3))
    np.testing.assert_allclose(found[2].deviation[~arm], 0.02 / np.sqrt(4))
    places = posed_joints(BODY, np.stack([*ways, expected]))[:, BODY.joint_names.index("r_wrist")]
    away = np.maximum(np.linalg.norm(places[:4] - places[4], axis=-1), LEAST_DISTANCE)
    assert found[2].disagreement is not None
    assert found[2].disagreement[RIGHT_ARM] == pytest.approx(np.exp(np.log(away).mean()))


def test_poses_are_steadied_by_parabolas() -> None:
    """Motion of a constant acceleration stays, tremble goes; lost frames are left out."""
    n, random = 31, np.random.default_rng(0)
    times = np.linspace(0, 1, n)[:, None]
    smooth = BODY.rest_pose + 0.3 * times**2 * np.isin(BODY.dof_names, ["pelvis.tx", "pelvis.rz"])
    known = np.arange(n) != 12
    np.testing.assert_allclose(smooth_poses(BODY, smooth, known, 5), smooth, atol=1e-12)
    noisy = smooth + random.normal(scale=0.01, size=smooth.shape)
    noisy = np.clip(noisy, BODY.lower, BODY.upper)
    noisy[12] = BODY.rest_pose
    found = smooth_poses(BODY, noisy, known, 5)
    np.testing.assert_array_equal(found[12], noisy[12])
    assert np.abs(found - smooth)[known].mean() < 0.75 * np.abs(noisy - smooth)[known].mean()
    np.testing.assert_array_equal(smooth_poses(BODY, noisy, known, 3), noisy)
    # Though angles go another way round to the same pose, its joints move steadily.
    wrist = BODY.joint_names.index("l_wrist")
    other = moved(BODY.rest_pose, **{f"l_upper_arm__r{axis}": 0.4 for axis in "xyz"})
    jumping = np.where(np.arange(n)[:, None] % 2, other, moved(other, l_upper_arm__ry=0.12))
    places = posed_joints(BODY, jumping)[:, wrist]
    found = posed_joints(BODY, smooth_poses(BODY, jumping, known, 5))[:, wrist]
    assert np.ptp(found[2:10], axis=0).max() < 0.6 * np.ptp(places[2:10], axis=0).max()
    # A limb that jumps to where it is found again stays on either side.
    again = np.where(np.arange(n)[:, None] < 20, BODY.rest_pose, moved(other, l_upper_arm__ry=1.0))
    away = posed_joints(BODY, smooth_poses(BODY, again, known, 5)) - posed_joints(BODY, again)
    assert np.abs(away[:, wrist]).max() < SAME_PLACE / 2


@pytest.mark.parametrize("name", ["song31", "rymut31_upper", "stick"])
def test_every_body_has_both_ways(name: str) -> None:
    """Those without limbs, or without a joint beside them, too."""
    body = bodies.named(name)
    poses = bodies.random_poses(body, 3)
    way = [estimate(pose, body=body) for pose in poses]
    found = fuse_passes(list(zip(way, way, strict=True)), np.zeros((3, 2)))
    np.testing.assert_allclose([one.pose for one in found], poses, atol=1e-12)


def test_a_limb_is_of_the_way_that_fits_over_the_frames() -> None:
    """One frame in which the wrong arm fits better changes nothing; the rest of the body is the
    mean all the same, and the arm stays where its way has it."""
    rest = BODY.rest_pose
    wrong = moved(rest, r_upper_arm__rx=-1.2, l_forearm__ry=-0.1)
    right = moved(rest, l_forearm__ry=0.1)
    for *ways, behind in ((wrong, right, -0.2), (right, wrong, 0.2)):
        errors = np.tile([0.0, behind], (9, 1))
        errors[4] *= -1
        np.testing.assert_allclose(together(*ways, errors), 9 * [rest], atol=1e-12)
    wrist = BODY.joint_names.index("r_wrist")
    right = moved(rest, pelvis__rx=0.06, r_upper_arm__rx=-0.3)
    wrong = moved(rest, pelvis__rx=-0.06, r_upper_arm__rx=-1.2)
    found = together(wrong, right, np.tile([0.2, 0.0], (5, 1)))
    np.testing.assert_allclose(found[:, BODY.dof_names.index("pelvis.rx")], 0, atol=1e-12)
    away = posed_joints(BODY, found)[:, wrist] - posed_joints(BODY, right[None])[0, wrist]
    assert np.linalg.norm(away, axis=-1).max() < 0.01


def test_a_lost_way_says_nothing() -> None:
    rest, other = BODY.rest_pose, moved(BODY.rest_pose, pelvis__tx=0.05)
    errors = np.tile([0.0, 9.0], (3, 1))
    ahead = [estimate(rest), estimate(rest, lost=True), estimate(rest, lost=True)]
    behind = [estimate(other), estimate(other), estimate(other, lost=True)]
    found = fuse_passes(list(zip(ahead, behind, strict=True)), errors)
    assert [one.lost for one in found] == [False, False, True]
    np.testing.assert_array_equal(found[1].pose, other)
    assert all(np.isnan(one.disagreement).all() for one in found[1:])


@dataclass
class Follower:
    """Estimates what it is shown, and remembers it."""

    body: BodyModel = BODY
    starts: list[float] = field(default_factory=list)
    seen: list[float] = field(default_factory=list)

    def start(self, pose: np.ndarray) -> None:
        self.starts.append(float(pose[0]))

    def step(self, shown: float) -> Estimate:
        self.seen.append(shown)
        return estimate(moved(BODY.rest_pose, pelvis__tx=shown))

    def score_poses(self, poses: np.ndarray) -> np.ndarray:
        return np.abs(poses - BODY.rest_pose)[:, ARM]


def frames(n: int, ending: BaseException | None = None) -> Iterator[tuple[int, float]]:
    for k in range(n):
        yield 5 + k, 0.01 * k
    if ending is not None:
        raise ending


def track_both_ways(
    found: list[tuple[int, list[Estimate]]],
    back: Follower,
    seen: Iterator[tuple[int, Any]],
    progress: Callable[[str], object] = lambda stage: None,
) -> None:
    """Add the estimates of all frames to `found`; an error that ends the frames is raised last."""
    ahead, keep = [Follower()], lambda *each: found.append(each)
    ways: Any = TwoWays(NumpyDevice(), ahead, [back], keep, progress)  # type: ignore[list-item]
    try:
        for index, shown in seen:
            ways.step(index, shown)
    finally:
        ways.finish()


@pytest.fixture
def short_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("apf.tracking.two_way.OVERLAP", 3)
    monkeypatch.setattr("apf.tracking.two_way.MOST_FRAMES", 12)


def test_windows_overlap_and_give_every_frame_once(short_windows: None) -> None:
    back, stages, found = Follower(), list[str](), list[tuple[int, list[Estimate]]]()
    track_both_ways(found, back, frames(25), stages.append)
    assert [index for index, _ in found] == list(range(5, 30))
    for (_, (one,)), (_, shown) in zip(found, frames(25), strict=True):
        assert one.pose[0] == pytest.approx(BODY.rest_pose[0] + shown)
    assert stages.count("tracking") == 25
    # Windows end at frames 11 and 20 and at the last; each is gone back from there.
    ends = np.array([11, 20, 24])
    np.testing.assert_allclose(back.starts, BODY.rest_pose[0] + 0.01 * ends, atol=1e-9)
    expected = [*range(11, -1, -1), *range(20, 8, -1), *range(24, 17, -1)]
    np.testing.assert_allclose(back.seen, 0.01 * np.array(expected))
    assert stages.count("tracking back") == len(expected)


@pytest.mark.parity("common/uncrop.uncrop")
def test_kept_frames_are_restored_about_the_foreground(device: Device) -> None:
    """Bit by bit there; away from it, where nobody is, they go on as at the rim."""
    rig, random = scenes.ring(3), np.random.default_rng(0)
    shape = (len(rig), rig.height, rig.width)
    evidence = random.integers(-90, 0, shape).astype(np.int8)
    evidence[0, 40:60, 70:90] = 50
    evidence[1, : rig.height // 2, -5:] = 50  # and nobody before the last camera
    pictures = random.integers(0, 255, (*shape, 3)).astype(np.uint8)
    before = surface_voxels(device, walker(0))
    kept = crop_voxels(before.cloud(), evidence, pictures)
    assert kept.nbytes < 0.5 * 4 * evidence.size
    later = surface_voxels(device, walker(5))
    other = crop_voxels(later.cloud(), -evidence, pictures[::-1])
    restored = RestoredVoxels(device, [kept, other])
    restored.show(other)  # of which nothing remains
    after = restored.show(kept)
    n = int(after.count.get()[0])
    np.testing.assert_array_equal(after.surface.get(n), before.surface.get())
    margin, height = round(0.05 * rig.width), rig.height
    parts = (
        (slice(40 - margin, 60 + margin), slice(70 - margin, 90 + margin)),
        (slice(0, height // 2 + margin), slice(rig.width - 5 - margin, None)),
        (slice(0, 1 + margin), slice(0, 1 + margin)),
    )
    for found, of in ((after.evidence.get(), evidence), (after.pictures().get(), pictures)):
        for view, (rows, columns) in enumerate(parts):
            expected = uncrop(of[view, rows, columns], (rows.start, columns.start), shape[1:])
            np.testing.assert_array_equal(found[view], expected)
            np.testing.assert_array_equal(found[view, rows, columns], of[view, rows, columns])
    assert (after.evidence.get() > 0).sum() == (evidence > 0).sum()


@pytest.mark.parametrize("ending", [KeyboardInterrupt(), InputError("a torn file")])
def test_what_ends_frames_is_raised_after_them(short_windows: None, ending: BaseException) -> None:
    back, found = Follower(), list[tuple[int, list[Estimate]]]()
    with pytest.raises(type(ending)):
        track_both_ways(found, back, frames(7, ending))
    assert len(found) == 7 and len(back.seen) == 7


@pytest.mark.parametrize("ending", [KeyboardInterrupt(), DeviceError("the device is lost")])
@pytest.mark.parametrize(("n", "kept"), [(7, 7), (25, 12)])
def test_the_way_back_ends(short_windows: None, ending: BaseException, n: int, kept: int) -> None:
    """All of it, be it the whole take or its first window."""

    def progress(stage: str) -> None:
        if stage == "tracking back":
            raise ending

    found: list[tuple[int, list[Estimate]]] = []
    with pytest.raises(type(ending)):
        track_both_ways(found, Follower(), frames(n), progress)
    assert len(found) == kept and np.isnan(found[3][1][0].disagreement).all()
