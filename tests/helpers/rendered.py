"""Random observations and poses for image objectives, and the checks of all renderers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage

from apf.body.mesh import BodyMesh
from apf.body.model import BodyModel
from apf.image_objective.config import ObjectiveConfig
from apf.image_objective.objective import ImageObjective
from apf.image_objective.renderer import draw_hypotheses, whole_pictures
from apf.reference.image_objective import render
from apf.scene import Scene
from cl import Device
from helpers import bodies
from psfs.cameras.camera import CameraRig


@dataclass(frozen=True)
class Maps:
    """What an objective observes."""

    maps: Any
    roi: Any
    labels: Any = None

    def on(self, device: Device) -> Maps:
        arrays = (self.maps, self.roi, self.labels)
        return Maps(*(None if a is None else device.to_device(a) for a in arrays))


def random_maps(rig: CameraRig, n_labels: int = 1, seed: int = 0) -> Maps:
    """Blobs for silhouettes, smooth edge proximity, regions that cut some of both off."""
    random = np.random.default_rng(seed)
    shape = (len(rig), rig.height, rig.width)
    smooth = ndimage.gaussian_filter(random.normal(size=(2, *shape)), (0, 0, 5, 5))
    blobs = np.where(smooth[0] > 0, 255, 0)
    nearness = 255 * (smooth[1] - smooth[1].min()) / np.ptp(smooth[1])
    roi = whole_pictures(rig)
    roi[0] += [3, 5, -40, -11]
    roi[-1] += [33, 0, -1, -2]
    segments = ndimage.gaussian_filter(random.normal(size=(n_labels + 1, *shape)), (0, 0, 4, 4))
    maps = np.rint(np.stack([blobs, nearness], -1)).astype(np.uint8)
    return Maps(maps, roi, segments.argmax(0).astype(np.uint8))


def scattered_poses(body: BodyModel, n: int) -> np.ndarray:
    """Poses in front of the cameras, at their sides, around and behind them."""
    poses = bodies.random_poses(body, n, wild=True)
    places = [i for i, name in enumerate(body.dof_names) if name[-3:] in (".tx", ".ty")]
    poses[:, places] = np.random.default_rng(n).normal(0, 2.5, (n, len(places)))
    poses[: n // 2, places] *= 0.1
    return np.clip(poses, body.lower, body.upper).astype(np.float32)


def errors_of(device: Device, objective: ImageObjective, poses: np.ndarray) -> np.ndarray:
    """(N,) errors of poses (N, D)."""
    for launch in objective.launcher(device.to_device(poses.astype(np.float32))):
        launch()
    return objective.errors.get()


def check_pictures(
    device: Device,
    body: BodyModel,
    rig: CameraRig,
    poses: np.ndarray,
    mesh: BodyMesh | None = None,
    round_ends: bool = False,
) -> None:
    """The device draws what the twin does, but for a boundary band: pixels on a part's outline,
    where rounding decides."""
    drawn = draw_hypotheses(Scene(device, rig, None, body), poses, mesh, round_ends)
    expected = render.draw_hypotheses(body, rig, poses, mesh, round_ends)
    differing = painted = 0
    for v, camera in enumerate(rig):
        width, height = camera.size
        for i, (parts, edges) in enumerate(expected[v]):
            picture = drawn[i, v, :height, :width]
            wrong = (parts != picture[..., 0]) | (edges != (picture[..., 1] > 0))
            differing += np.count_nonzero(wrong)
            painted += np.count_nonzero(parts)
            assert np.count_nonzero(drawn[i, v]) == np.count_nonzero(picture)  # no padding
    assert painted > 500
    assert differing <= 2 + 1e-3 * painted


def check_counts(
    device: Device,
    body: BodyModel,
    rig: CameraRig,
    poses: np.ndarray,
    n_labels: int = 1,
    mesh: BodyMesh | None = None,
) -> None:
    """What is counted is what is drawn, to the pixel."""
    n_parts = len(body.cones) if mesh is None else mesh.n_parts
    labels = tuple(1 + i % n_labels for i in range(n_parts)) if n_labels > 1 else ()
    observed = random_maps(rig, n_labels)
    config = ObjectiveConfig(labels=labels)
    objective = ImageObjective(Scene(device, rig, None, body), len(poses), config, mesh)
    objective.observe(observed.on(device))
    errors_of(device, objective, poses)
    counts = objective.counts.get()
    pictures = draw_hypotheses(Scene(device, rig, None, body), poses, mesh)
    label_of = np.array([0, *(labels or [1] * n_parts)])
    for v, (x0, y0, x1, y1) in enumerate(observed.roi):
        parts, edges = np.moveaxis(pictures[:, v, y0:y1, x0:x1], -1, 0)
        maps, segments = observed.maps[v, y0:y1, x0:x1], observed.labels[v, y0:y1, x0:x1]
        near_edge = (edges > 0) * maps[..., 1].astype(int)
        assert (counts[v, :, 0] == (edges > 0).sum((1, 2))).all()
        assert (counts[v, :, 1] == near_edge.sum((1, 2))).all()
        for label in range(1, n_labels + 1):
            model = label_of[parts] == label
            image = segments == label if labels else maps[..., 0] > 127
            assert (counts[v, :, 2 * label] == model.sum((1, 2))).all()
            assert (counts[v, :, 2 * label + 1] == (model & image).sum((1, 2))).all()
    assert counts[..., 1].max() > 0
    assert counts[..., 3].max() > 0
