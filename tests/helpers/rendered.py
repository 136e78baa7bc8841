"""Random observations and poses for image objectives, and the checks of all renderers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import ndimage

from apf.body.mesh import BodyMesh
from apf.body.model import BodyModel
from apf.image_objective.objective import ImageObjective
from apf.image_objective.renderer import draw_hypotheses, whole_pictures
from apf.reference.image_objective import render
from apf.reference.image_objective.objective import count_pixels
from apf.scene import Scene
from cl import Device
from psfs.cameras.camera import CameraRig


@dataclass(frozen=True)
class Maps:
    """What an objective observes."""

    maps: Any
    roi: Any

    def on(self, device: Device) -> Maps:
        return Maps(device.to_device(self.maps), device.to_device(self.roi))


def random_maps(rig: CameraRig, seed: int = 0) -> Maps:
    """Blobs for silhouettes, smooth edge proximity, regions that cut some of both off."""
    random = np.random.default_rng(seed)
    shape = (len(rig), rig.height, rig.width)
    smooth = ndimage.gaussian_filter(random.normal(size=(2, *shape)), (0, 0, 5, 5))
    blobs = np.where(smooth[0] > 0, 255, 0)
    nearness = 255 * (smooth[1] - smooth[1].min()) / np.ptp(smooth[1])
    roi = whole_pictures(rig)
    roi[0] += [3, 5, -40, -11]
    roi[-1] += [33, 0, -1, -2]
    return Maps(np.rint(np.stack([blobs, nearness], -1)).astype(np.uint8), roi)


def score_poses(device: Device, objective: ImageObjective, poses: np.ndarray) -> np.ndarray:
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
    mesh: BodyMesh | None = None,
) -> None:
    """What is counted is what is drawn, to the pixel."""
    observed = random_maps(rig)
    objective = ImageObjective(Scene(device, rig, None, body), len(poses), mesh=mesh)
    objective.observe(observed.on(device))
    score_poses(device, objective, poses)
    counts = objective.counts.get()
    drawn = draw_hypotheses(Scene(device, rig, None, body), poses, mesh).swapaxes(0, 1)
    pictures = [[(one[..., 0], one[..., 1] > 0) for one in view] for view in drawn]
    np.testing.assert_array_equal(counts, count_pixels(pictures, observed.maps, observed.roi))
    assert counts[..., 1].max() > 0
    assert counts[..., 3].max() > 0
