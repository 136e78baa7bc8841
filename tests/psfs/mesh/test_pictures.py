"""Silhouettes and pictures of meshes."""

from dataclasses import replace

import numpy as np
import trimesh
from helpers import scenes

from psfs.cameras.camera import Camera
from psfs.mesh.preview import mesh_silhouette
from psfs.output.preview import draw_views

CENTRE, RADIUS = np.array([0.1, -0.2, 0.9]), 0.4


def ball() -> trimesh.Trimesh:
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=RADIUS)
    mesh.apply_translation(CENTRE)
    return mesh


def camera(**changes: object) -> Camera:
    given = scenes.looking_at("c", np.array([2.5, 1.0, 1.4]), CENTRE, (161, 121), 150.0)
    return replace(given, **changes)  # type: ignore[arg-type]


def test_silhouette_of_a_ball() -> None:
    """The silhouette is the rays that pass the centre at less than the radius."""
    view = camera()
    pixels = np.stack(np.meshgrid(np.arange(161), np.arange(121)), -1).reshape(-1, 2)
    directions = view.rays(pixels)
    passing = np.linalg.norm(np.cross(directions, CENTRE - view.centre), axis=1)
    expected = (passing / np.linalg.norm(directions, axis=1) < RADIUS).reshape(121, 161)
    shown = mesh_silhouette(ball(), view)
    assert 500 < expected.sum() < 10_000 and (shown != expected).sum() <= 0.005 * expected.sum()


def test_around_and_behind_the_camera() -> None:
    """A camera inside the ball sees only the ball; one that looks away from it does not see it."""
    view = camera()
    inside = replace(view, t=-view.R @ CENTRE)
    assert mesh_silhouette(ball(), inside).all()
    away = replace(view, t=-view.R @ (CENTRE + 2 * view.R[2]))
    assert not mesh_silhouette(ball(), away).any()


def test_shaded_views_show_shape_and_colours() -> None:
    mesh = ball()
    surface = mesh.vertices, mesh.vertex_normals
    plain = draw_views(*surface, None, 0.05)[0]
    assert plain.shape == (420, 300, 3) and plain.dtype == np.uint8
    assert plain[210, 150, 2] > plain[210, 150, 0]  # clay
    assert plain[175, 115].sum() > plain[255, 200].sum() + 30  # lit from the upper left
    colours = np.tile(np.uint8([10, 200, 10]), (len(mesh.vertices), 1))
    assert draw_views(*surface, colours, 0.05)[0][210, 150].argmax() == 1
