"""The 3-D view through a camera: its picture without distortion, and where clicks meet."""

from dataclasses import replace

import cv2
import numpy as np
from helpers.scenes import ring

from psfs.page.look_through import (
    crosses,
    find_straight_map,
    locate_point,
    straighten,
)


def test_pictures_are_shown_where_the_scene_has_them() -> None:
    camera = ring(1, (160, 120))[0]
    camera = replace(camera, distortion=np.array([-0.2, 0.05, 0.002, -0.001, 0.0]))
    point = camera.centre + camera.rays(np.array([[100.0, 40.0]]))[0]
    picture = np.zeros((120, 160, 3), np.uint8)
    cv2.circle(picture, (100, 40), 2, (255, 255, 255), -1)
    fov, aspect = 1.2, 1.5
    shown = straighten(picture, find_straight_map(camera, fov, aspect)).mean(axis=-1)
    height, width = shown.shape
    x, y, depth = camera.R @ point + camera.t
    focal = height / 2 / np.tan(fov / 2)
    expected = np.array([x, y]) / depth * focal + np.array([width - 1, height - 1]) / 2
    rows, columns = np.indices(shown.shape)
    found = np.array([(columns * shown).sum(), (rows * shown).sum()]) / shown.sum()
    assert np.abs(found - expected).max() < 3 and width == round(1.5 * height)


def test_clicks_meet_at_the_joint() -> None:
    rig, joint = ring(4), np.array([0.2, -0.1, 1.1])
    rays = {view: 3 * (joint - rig[view].centre) for view in (0, 2, 3)}
    place, apart = locate_point(rays, rig)
    assert np.allclose(place, joint) and apart < 1e-9
    assert crosses(rays) and not crosses({0: rays[0], 2: rays[2]})  # 2 is opposite of 0
    rays[0] = rays[0] + np.array([0.0, 0.0, 0.3])
    assert locate_point(rays, rig)[1] > 0.02
