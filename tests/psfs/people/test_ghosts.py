"""What nothing fills between people who stand is nobody's, and one person's pixels no other's."""

from __future__ import annotations

import numpy as np
from helpers import scenes

from psfs.cameras.camera import CameraRig
from psfs.people.agreement import Disagreement
from psfs.people.ghosts import Ghosts
from psfs.people.standing import StandingPeople

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


def test_others_must_hide_what_is_nobodys_part() -> None:
    rig = facing_rig().subset(["left", "right"])
    before_trunk, beside_other = [-0.95, 0.0, 1.1], [-0.25, 0.22, 1.1]  # `right` sees the latter so
    points = np.array([before_trunk, beside_other])
    assert Ghosts(rig, STANDING, 3).find_own(0, points).tolist() == [True, False]


def test_colours_say_what_is_nobodys_part() -> None:
    rig = facing_rig().subset(["left", "right"])
    kept, dropped, trunk = [-0.95, 0.0, 1.1], [-0.25, 0.22, 1.1], [-0.6, 0.05, 1.2]
    points = np.array([kept, dropped, trunk])
    ghosts = Ghosts(rig, STANDING, 3)
    for values, expected in (
        ([0.0, 0.0, 9.0], [True, True, True]),  # a person's inside stays
        ([9.0, 9.0, 9.0], [False, False, True]),
        ([np.nan] * 3, [True, False, True]),  # as without colours
    ):
        colours = Disagreement(np.floor(points / 0.04), np.array(values))
        assert ghosts.find_own(0, points, colours).tolist() == expected
