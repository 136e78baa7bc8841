"""Contours of the pictures, and their kernels against the twin."""

import cv2
import numpy as np
import pytest
from helpers import bodies, scenes
from helpers.likelihoods import assert_cost_nothing, observe_pictures

from apf.body.kinematics import posed_cones
from apf.likelihood.contour import FULL_CONTRAST, Contours
from apf.likelihood.part_colour import list_scored_parts
from apf.likelihood.voxel import choose_cone_sampling, make_sample_rows
from apf.reference.image_objective.render import draw_hypotheses
from apf.reference.likelihood.contour import compute_contours, compute_gradients, contour_means
from cl import Device

SONG = bodies.named("song31")
RIG = scenes.ring(4, (161, 121))


def painted(pose: np.ndarray, arms: int) -> tuple[np.ndarray, np.ndarray]:
    """Pictures (V, H, W, 3) of a person in this pose, `arms` grey at the arms and 90 elsewhere, and
    maps (V, H, W, 2) of the silhouettes."""
    bare = [cone.name[2:] in ("forearm", "upper_arm") for cone in SONG.cones]
    grey = np.array([30, *np.where(bare, arms, 90)], np.uint8)
    pictures = np.zeros((len(RIG), RIG.height, RIG.width, 3), np.uint8)
    maps = np.zeros((len(RIG), RIG.height, RIG.width, 2), np.uint8)
    for view, drawn in enumerate(draw_hypotheses(SONG, RIG, pose[None])):
        parts = drawn[0][0]
        height, width = parts.shape
        pictures[view, :height, :width] = grey[parts][..., None]
        shown = cv2.dilate((parts > 0) * np.uint8(255), np.ones((5, 5)))
        maps[view, :height, :width] = shown[..., None]
    return pictures, maps


def means(poses: np.ndarray, contours: np.ndarray) -> np.ndarray:
    """The term's means (N,) over the cameras."""
    rows = make_sample_rows(choose_cone_sampling(SONG, 0.06))
    look = list_scored_parts(SONG, rows), rows
    cones = posed_cones(SONG, poses)
    views = zip(RIG, contours, strict=True)
    return np.mean([contour_means(camera, SONG, cones, view, *look) for camera, view in views], 0)


def test_an_arm_before_the_trunk_is_found_by_its_contours() -> None:
    """Of the trunk's own grey it has few there."""
    gain = {}
    for arms in (150, 90):
        pictures, maps = painted(bodies.crossing(), arms)
        contours = compute_contours(compute_gradients(pictures, maps), maps, FULL_CONTRAST)
        hanging, right = means(np.stack([SONG.rest_pose, bodies.crossing()]), contours)
        gain[arms] = right - hanging
    assert gain[150] > 0.005 and gain[150] > gain[90] + 0.01


def test_contours_know_their_direction_and_end_at_the_silhouette() -> None:
    pictures, maps = np.full((1, 40, 40, 3), 50, np.uint8), np.full((1, 40, 40, 2), 255, np.uint8)
    pictures[:, :, 20:], maps[:, :20] = 90, 0
    contrast = 20 * 128  # the gain of the operator
    found = compute_contours(compute_gradients(pictures, maps), maps, contrast)[0]
    assert not found[:, :20].any() and found[0, 30, 20] > 2 * found[2, 30, 20] == 0
    assert found[1, 30, 20] == found[3, 30, 20] < found[0, 30, 20]
    assert found[0, 30, 16] > 0 == found[0, 30, 10]


@pytest.mark.parity("tracking/contour.differentiate", "tracking/contour.find_contours")
def test_contours_are_those_of_the_twin(device: Device) -> None:
    rig = scenes.ring(3)
    shape = (len(rig), rig.height, rig.width, 3)
    images = np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8)
    images[0] = cv2.GaussianBlur(images[0], (0, 0), 2.0)
    here, twin, _ = observe_pictures(device, rig, images)
    term = here.terms["contour"]
    assert isinstance(term, Contours) and term.known
    found, maps = term.contours.get(), here.reprojection.maps.get()
    gradients = compute_gradients(images, maps)
    np.testing.assert_array_equal(found, compute_contours(gradients, maps, FULL_CONTRAST))
    assert np.abs(gradients).max() > 1000 and 0.02 < (found > 0).mean() < 0.98
    assert ((found > 0) == (twin.terms["contour"].contours > 0)).mean() > 0.98


def test_without_pictures_contours_cost_nothing(device: Device) -> None:
    assert_cost_nothing(device, contour_weight=4.0)
