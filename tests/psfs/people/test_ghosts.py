"""What nothing fills between people who stand is nobody's, and one person's pixels no other's."""

from __future__ import annotations

import numpy as np
from helpers import scenes

from psfs.background.standing import StandingPeople
from psfs.cameras.camera import CameraRig
from psfs.people.agreement import Disagreement
from psfs.people.contact import SplitCloud
from psfs.people.ghosts import Ghosts

SIZE = 160
STANDING = StandingPeople(
    np.array([3]), np.array([[[-0.6, 0.0, 1.7], [0.6, 0.0, 1.5], [np.nan] * 3]])
)


def facing_rig() -> CameraRig:
    """Two cameras that see both people behind one another, from either side, and two that see them
    side by side."""
    places = {"left": (-4.0, 0.0), "right": (4.0, 0.0), "front": (0.0, -4.0), "back": (0.0, 4.0)}
    target = np.array([0.0, 0.0, 0.8])
    return scenes.without_distortion(
        CameraRig(
            tuple(
                scenes.looking_at(name, np.array([*place, 0.8]), target, (SIZE, SIZE), 180)
                for name, place in places.items()
            )
        )
    )


def test_what_only_people_explain_is_nobodys_part() -> None:
    trunk, lifted_arm = [-0.6, 0.05, 1.2], [-0.6, 0.0, 2.0]
    between, beyond = [-0.25, 0.0, 1.1], [-0.25, 0.1, 0.9]
    points = np.array([trunk, lifted_arm, between, beyond])
    others, nobody = np.array([[0.6, 0.1, 1.0], [0.2, 0.0, 1.0]]), np.array([[0.0, 0.0, 1.0]])
    # `left` and `right` alone see people there: `front` and `back` see between them.
    clouds = [points, others, points[:0], nobody]
    split = SplitCloud(clouds, clouds, [points[:0]] * 3)
    rig = facing_rig()
    left = Ghosts(rig, STANDING, 3).drop(split)
    assert left.sole is left.clouds
    assert [len(cloud) for cloud in left.clouds] == [4, 2, 0, 1]
    # With one of these alone, what lies between is free in one camera.
    left = Ghosts(rig.subset(["left", "right", "front"]), STANDING, 3).drop(split)
    np.testing.assert_array_equal(left.clouds[0], [trunk, lifted_arm])
    np.testing.assert_array_equal(left.clouds[1], others[:1])
    np.testing.assert_array_equal(left.clouds[3], nobody)


def test_before_a_good_background_others_must_hide_what_is_nobodys_part() -> None:
    rig = facing_rig().subset(["left", "right"])
    before_trunk, beside_other = [-0.95, 0.0, 1.1], [-0.25, 0.22, 1.1]  # `right` sees the latter so
    points = np.array([before_trunk, beside_other])
    for poor, expected in ((True, [False, False]), (False, [True, False])):
        assert Ghosts(rig, STANDING, 3, poor).find_own(0, points).tolist() == expected


def test_colours_say_what_is_nobodys_part() -> None:
    rig = facing_rig().subset(["left", "right"])
    kept, dropped, trunk = [-0.95, 0.0, 1.1], [-0.25, 0.22, 1.1], [-0.6, 0.05, 1.2]
    points = np.array([kept, dropped, trunk])
    ghosts = Ghosts(rig, STANDING, 3, poor=False)
    for values, expected in (
        ([0.0, 0.0, 9.0], [True, True, True]),  # a person's inside stays
        ([9.0, 9.0, 9.0], [False, False, True]),
        ([np.nan] * 3, [True, False, True]),  # as without colours
    ):
        colours = Disagreement(np.floor(points / 0.04), np.array(values))
        assert ghosts.find_own(0, points, colours).tolist() == expected


def test_who_stands_alone_in_a_picture_is_unknown_to_others() -> None:
    rig = facing_rig()
    ghosts = Ghosts(rig, STANDING, 3)
    masks = np.full((3, len(rig), SIZE, SIZE), 255, np.uint8)
    masks[:, :, :, SIZE // 2] = 0
    ghosts.hide_others(masks)
    first, second, absent = ghosts.covered[:, 2]  # in `front`
    assert first.sum() > 500 and second.sum() > 400 and not (first & second).any()
    assert not absent.any() and not ghosts.covered[2].any()
    assert (masks[0, 2][second] == 128).all() and (masks[0, 2][first] == 255).all()
    assert (masks[1, 2][first] == 128).all() and (masks[1, 2][second] == 255).all()
    free = ~(first | second)
    assert (masks[:2, 2][:, free & (np.arange(SIZE) != SIZE // 2)] == 255).all()
    assert (masks[:, :, :, SIZE // 2] == 0).all()
    behind = ghosts.covered[:2, 0].all(0)  # in `left` both lie behind one another
    assert behind.any() and not (masks[:2, 0] == 128)[:, behind].any()
