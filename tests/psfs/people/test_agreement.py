"""Cameras that see one place agree on its colour; those that look through it do not."""

from __future__ import annotations

import numpy as np
from helpers import scenes

from psfs.cameras.camera import CameraRig
from psfs.people.agreement import measure_disagreement

SIZE = 120
FAR = 1e6
#: What each camera sees behind a ghost.
GREYS = 40, 44, 160


def test_cameras_that_see_a_place_say_whether_it_has_one_colour() -> None:
    target = np.array([0.0, 0.0, 0.8])
    spots = [(-4.0, -1.0), (-3.0, 3.0), (4.0, 0.0)]
    rig = scenes.without_distortion(
        CameraRig(
            tuple(
                scenes.looking_at(f"c{k}", np.array([*spot, 0.8]), target, (SIZE, SIZE), 200)
                for k, spot in enumerate(spots)
            )
        )
    )
    arm, ghost, hidden = np.array([[0.0, 0.0, 1.3], [0.0, 0.0, 0.8], [0.0, 0.0, 0.3]])
    images = np.full((3, SIZE, SIZE, 3), 20, np.uint8)
    depths = np.full((3, SIZE, SIZE), FAR)
    for view, camera in enumerate(rig):
        _, (row,), (column,), (depth,) = camera.look_up(arm[None])
        images[view, row - 3 : row + 4, column - 3 : column + 4] = 92, 120, 200
        if view == 2:  # somebody else stands before it
            images[view, row - 3 : row + 4, column - 3 : column + 4] = 200, 30, 30
            depths[view, row, column] = depth - 0.5
        _, (row,), (column,), _ = camera.look_up(ghost[None])
        images[view, row - 3 : row + 4, column - 3 : column + 4] = GREYS[view]
        _, (row,), (column,), (depth,) = camera.look_up(hidden[None])
        depths[view, row, column] = depth - 0.1 * (view > 0)
    images[1] = 0.75 * (images[1] + 8.0) - 8  # darker, as another camera
    trunk = np.random.default_rng(1).uniform([-0.4, -0.4, 0.2], [-0.3, 0.4, 1.5], (40, 3))
    points = np.concatenate([[arm, ghost, hidden], trunk])
    found = measure_disagreement(rig, images, depths, points, 0.02)
    one, other, unknown = found.find(np.stack([arm + 0.01, ghost + 0.01, hidden]))
    near = np.sqrt(3) * np.log((GREYS[1] + 8) / (GREYS[0] + 8))  # the third is far from both
    np.testing.assert_allclose(other, (near + 2 * 0.4) / 3, rtol=1e-3)
    assert one < 1e-3
    assert np.isnan(unknown)
    assert np.isnan(found.find(np.array([[0.5, 0.0, 0.8]])))
    nobody = measure_disagreement(rig, images, depths, points[:0], 0.02)
    assert np.isnan(nobody.find(points)).all()
