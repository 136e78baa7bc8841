"""OpenGL: pictures and scores of the OpenCL renderer's, but for a boundary band."""

import threading
from dataclasses import replace

import cv2
import numpy as np
import pytest
from helpers import bodies, rendered, scenes

from apf.backend import check_renderer, make_device_tracker
from apf.body.mesh import cone_mesh
from apf.filters.method import Method
from apf.image_objective.config import ObjectiveConfig
from apf.image_objective.objective import ImageObjective
from apf.image_objective.opengl.context import egl_context
from apf.image_objective.opengl.objective import OpenGLObjective
from apf.image_objective.opengl.renderer import OpenGLRenderer, draw_by_opengl
from apf.image_objective.renderer import draw_hypotheses
from apf.scene import Scene
from cl import Device, InputError, NumpyDevice
from psfs.cameras.camera import CameraRig

OPENGL = ObjectiveConfig(renderer="opengl")


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
def test_pictures_equal_opencl(device: Device, vertices: int) -> None:
    body, rig = bodies.named("song31"), scenes.ring(3, (333, 240))
    mesh = cone_mesh(body, vertices) if vertices > 4 else None
    poses = np.concatenate([bodies.scattered_poses(body, 6), bodies.random_poses(body, 20)])
    drawn = draw_by_opengl(body, rig, poses, mesh)
    expected = draw_hypotheses(Scene(device, rig, None, body), poses, mesh, round_ends=False)
    assert drawn.shape == expected.shape
    parts, edges = expected.reshape(-1, *expected.shape[2:4], 2).transpose(3, 0, 1, 2)
    gl_parts, gl_edges = drawn.reshape(-1, *drawn.shape[2:4], 2).transpose(3, 0, 1, 2)
    assert np.count_nonzero(parts) > 50_000
    # Pixels on an outline, where rounding decides.
    assert np.count_nonzero(parts != gl_parts) <= 1e-3 * np.count_nonzero(parts)
    assert np.count_nonzero(edges) > 5_000
    if mesh is None:
        assert np.count_nonzero(edges != gl_edges) <= 3e-3 * np.count_nonzero(edges)
    else:  # whose edges are lines along the outline, inside of it or outside
        assert beyond(edges > 0, gl_edges) <= 3e-3 * np.count_nonzero(edges)
        assert beyond(gl_edges > 0, edges) <= 3e-3 * np.count_nonzero(edges)


@pytest.mark.parametrize(("kind", "vertices"), [("sp", 4), ("aosp", 18), ("posp", 4)])
def test_scores_equal_opencl(device: Device, kind: str, vertices: int) -> None:
    body, rig = bodies.named("song31"), scenes.ring(3, (161, 123))
    poses = np.concatenate([bodies.scattered_poses(body, 6), bodies.random_poses(body, 31)])
    config = ObjectiveConfig(
        kind=kind, silhouette_weight=0.4, edge_weight=0.6, vertices_per_part=vertices
    )
    tsai = replace(rig[1], distortion=np.zeros(5), kappa=0.15)
    rig = CameraRig((rig[0], tsai, rig[2]))
    scene = Scene(device, rig, None, body)
    kernels, shaders = (o(scene, len(poses), config) for o in (ImageObjective, OpenGLObjective))
    for seed in range(2):  # a second frame with other regions of interest
        observed = rendered.random_maps(rig, seed)
        observed.roi[1] += [seed, 2 * seed, -7 * seed, -seed]
        for objective in (kernels, shaders):
            objective.observe(observed.on(device))
        expected = rendered.score_poses(device, kernels, poses)
        errors = rendered.score_poses(device, shaders, poses)
        counts = kernels.counts.get()
        off = np.abs(counts - shaders.counts).sum((0, 1)) / counts.sum((0, 1))
        assert expected.std() > 0.005
        assert (off[2:] <= 2e-3).all()
        # A mesh's edges are lines that lie a pixel beside those that the kernels find.
        assert off[:2].max() <= (3e-3 if vertices == 4 else 0.1)
        assert np.abs(errors - expected).max() <= (1e-3 if vertices == 4 else 0.02)


def test_more_pictures_than_tiles(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("apf.image_objective.opengl.renderer._LARGEST", 400)
    body, rig = bodies.named("song31"), scenes.ring(2, (161, 123))
    poses = bodies.random_poses(body, 20).astype(np.float32)
    objectives = [o(Scene(device, rig, None, body), 20) for o in (ImageObjective, OpenGLObjective)]
    errors = []
    for objective in objectives:
        objective.observe(rendered.random_maps(rig).on(device))
        errors.append(rendered.score_poses(device, objective, poses))
    assert len(list(objectives[1].renderer.batches())) > 4
    np.testing.assert_allclose(errors[1], errors[0], atol=1e-3)


def test_a_swarm_tracks_by_opengl_from_any_thread(device: Device) -> None:
    body, rig = bodies.named("song31"), scenes.ring(3, (161, 123))
    scene, observed = Scene(device, rig, None, body), rendered.random_maps(rig).on(device)
    method = Method.create("pso", "sp", n_particles=24, n_layers=3).replace(image=OPENGL)
    found: list[np.ndarray] = []

    def track(tracker: object) -> None:
        tracker.start(body.rest_pose)
        found.append(tracker.step(observed).pose)

    for _ in range(2):
        tracker = make_device_tracker(scene, method)
        threads = [threading.Thread(target=track, args=(tracker,)) for _ in range(2)]
        for thread in threads:
            thread.start()
            thread.join()
    assert np.abs(found[0] - body.rest_pose).max() > 0
    assert all((pose == found[0]).all() for pose in found)


def test_what_opengl_cannot(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match="round ends"):
        OPENGL.replace(round_ends=True)
    with pytest.raises(InputError, match="renderer is 'metal'; expected opencl, opengl"):
        ObjectiveConfig(renderer="metal")
    with pytest.raises(InputError, match="the device is numpy"):
        check_renderer(NumpyDevice(), Method.create("pso", "sp").replace(image=OPENGL))
    monkeypatch.setattr("apf.image_objective.opengl.renderer._LARGEST", 100)
    with pytest.raises(InputError, match="161 x 123; OpenGL draws up to 100 px"):
        OpenGLRenderer(bodies.named("song31"), scenes.ring(2, (161, 123)), 3)
