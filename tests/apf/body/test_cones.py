"""Tapered cones: outlines and distances compared with independent geometry."""

import numpy as np
import pytest
from helpers import scenes
from helpers.bodies import cone

from apf.body.cones import outline_corners, project_outlines
from psfs.common.cones import cone_distances


def surface(row: np.ndarray, n_rows: int = 41, n_around: int = 180) -> np.ndarray:
    """Return points (n_rows, n_around, 3) on the mantle of a cone."""
    a, b, x, y = row[0:3], row[4:7], row[8:11], row[12:15]
    t = np.linspace(0, 1, n_rows)[:, None, None]
    angle = np.linspace(0, 2 * np.pi, n_around, endpoint=False)[None, :, None]
    radius = row[3] + t * (row[7] - row[3])
    around = np.cos(angle) * x / (x @ x) + np.sin(angle) * y / (y @ y)
    return a + t * (b - a) + radius * around


CAMERA = scenes.looking_at("c", np.array([3.0, 0, 1]), np.array([0.0, 0, 1]), (640, 480), 500.0)
CONES = {
    "upright": cone([0, 0, 0], [0, 0, 1]),
    "tapered": cone([0.2, 0.1, 0.3], [0.5, -0.2, 0.9], (0.2, 0.05)),
    "elliptic": cone([0, 0, 0], [0.1, 0, 0.6], (0.15, 0.2), (0.2, 1, 0), (1.3, 0.5)),
}


@pytest.mark.parametrize("row", CONES.values(), ids=CONES)
def test_mantles_are_at_distance_zero_and_corners_lie_on_the_rims(row: np.ndarray) -> None:
    mantle = surface(row).reshape(-1, 3)
    np.testing.assert_allclose(cone_distances(mantle, row[None]), 0, atol=1e-12)
    corners = outline_corners(np.array([3.0, 1.0, 2.0]), row)
    np.testing.assert_allclose(cone_distances(corners, row[None]), 0, atol=1e-12)
    axis = row[4:7] - row[0:3]
    np.testing.assert_allclose((corners[:2] - row[0:3]) @ axis, 0, atol=1e-12)
    np.testing.assert_allclose((corners[2:] - row[4:7]) @ axis, 0, atol=1e-12)
    # Opposite ends of a diameter: A + s, A - s, B - s, B + s.
    np.testing.assert_allclose(corners[:2].mean(0), row[0:3], atol=1e-12)
    np.testing.assert_allclose(corners[2:].mean(0), row[4:7], atol=1e-12)
    assert (corners[0] - corners[1]) @ (corners[3] - corners[2]) > 0


@pytest.mark.parametrize("row", CONES.values(), ids=CONES)
@pytest.mark.parametrize("direction", [(1, 0.2, 0.1), (-0.5, 1, 0.7), (0.3, -1, -0.4)])
def test_outline_is_the_silhouette_seen_from_afar(row: np.ndarray, direction: tuple) -> None:
    """Seen from far away, the trapezoid covers exactly the mantle."""
    eye = 500 * np.array(direction) / np.linalg.norm(direction)
    corners = outline_corners(eye, row)
    # Across the axis in the picture plane.
    across = np.cross(row[4:7] - row[0:3], eye)
    across /= np.linalg.norm(across)
    rims = surface(row, 2) @ across
    for rim, ends in zip(rims, (corners[:2] @ across, corners[2:] @ across), strict=True):
        tolerance = 0.005 * np.ptp(rim)
        assert ends.max() == pytest.approx(rim.max(), abs=tolerance)
        assert ends.min() == pytest.approx(rim.min(), abs=tolerance)


def test_cones_with_an_unseen_corner_have_no_outline() -> None:
    """A corner beside the camera may have its pixel at 1e17: no line to it can be drawn."""
    behind, astride = cone([5, 0, 0], [5, 0, 1]), cone([2, 0, 1], [4, 0, 1.1])
    beside = cone([2.9, 0.5, 0.5], [2.5, 0, 1.2])
    assert CAMERA.max_radius2 == np.inf
    assert (CAMERA.project(outline_corners(CAMERA.centre, beside))[1] > 0).all()
    outlines = project_outlines(CAMERA, np.stack([behind, astride, beside, CONES["upright"]]))
    assert np.isnan(outlines[:3]).all() and np.isfinite(outlines[3]).all()


def test_distances_to_a_cylinder() -> None:
    row = cone([0, 0, 0], [0, 0, 1], (0.1, 0.1))[None]
    points = np.array(
        [[0, 0, 0.5], [0.3, 0, 0.5], [0, -0.1, 0.2], [0, 0, 1.4], [0.3, 0, 1.4], [0.05, 0, -0.1]]
    )
    expected = [-0.1, 0.2, 0.0, 0.3, 0.4, np.hypot(0.05, 0.1) - 0.1]
    np.testing.assert_allclose(cone_distances(points, row)[:, 0], expected, atol=1e-12)
