"""Rendering by OpenGL: the same pictures as the OpenCL renderer's, within a pixel."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from helpers import bodies, rendered, scenes

from apf.body.mesh import cone_mesh
from apf.image_objective.opengl import OpenGLRenderer, egl_context
from apf.image_objective.renderer import draw_hypotheses
from apf.scene import Scene
from cl import Device, InputError


@pytest.fixture(scope="module", autouse=True)
def _needs_opengl() -> None:
    try:
        egl_context().release()
    except InputError as error:
        pytest.skip(str(error))


def beyond(edges: np.ndarray, others: np.ndarray) -> int:
    """Pixels of `edges` (K, H, W) with none of `others` in their 3 x 3 neighbourhood."""
    near = np.stack([cv2.dilate(o.astype(np.uint8), np.ones((3, 3), np.uint8)) for o in others])
    return int(np.count_nonzero(edges & (near == 0)))


@pytest.mark.parametrize("vertices", [4, 8, 34])
def test_pictures_equal_opencl_within_a_pixel(device: Device, vertices: int) -> None:
    body, rig = bodies.named("song31"), scenes.ring(3, (333, 240))
    mesh = cone_mesh(body, vertices) if vertices > 4 else None
    # More pictures than the frame buffer has tiles.
    poses = np.concatenate([rendered.scattered_poses(body, 6), bodies.random_poses(body, 20)])
    renderer = OpenGLRenderer(body, rig, mesh)
    assert renderer.n_tiles < len(poses) * len(rig)
    drawn, expected = (
        renderer.draw(poses),
        draw_hypotheses(Scene(device, rig, None, body), poses, mesh, round_ends=False),
    )
    assert drawn.shape == expected.shape
    parts, edges = expected.reshape(-1, *expected.shape[2:4], 2).transpose(3, 0, 1, 2)
    gl_parts, gl_edges = drawn.reshape(-1, *drawn.shape[2:4], 2).transpose(3, 0, 1, 2)
    assert np.count_nonzero(parts) > 50_000
    # Pixels on an outline, where the rules of filling differ.
    assert np.count_nonzero(parts != gl_parts) <= 1e-3 * np.count_nonzero(parts)
    assert np.count_nonzero(edges) > 5_000
    assert beyond(edges > 0, gl_edges) <= 3e-3 * np.count_nonzero(edges)
    assert beyond(gl_edges > 0, edges) <= 3e-3 * np.count_nonzero(edges)
