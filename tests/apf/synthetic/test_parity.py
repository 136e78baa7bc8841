"""The renderer's kernel and its NumPy twin see the same silhouette and depth, on every device."""

from __future__ import annotations

import numpy as np
import pytest

from apf.reference.synthetic.scene import silhouette
from apf.synthetic.body import Flesh
from apf.synthetic.gait import Gait
from apf.synthetic.render import Renderer
from apf.synthetic.scene import SceneConfig, make_furniture, make_rig
from apf.synthetic.walk import Walk
from cl import Device
from psfs.cameras.camera import Camera, CameraRig


def looking(centre: list[float], target: list[float], size: tuple[int, int]) -> Camera:
    forward = np.subtract(target, centre)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.stack([right, np.cross(forward, right), forward])
    focal = 0.9 * max(size)
    K = np.array([[focal, 0.5, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]])
    return Camera("one", K, np.array([-0.1, 0.02, 1e-3, -1e-3, 0.01]), R, -R @ centre, size)


def rigs(pelvis: np.ndarray) -> dict[str, CameraRig]:
    x, y = pelvis[:2]
    near = looking([x + 0.9, y + 0.5, 1.3], [x, y, 1.1], (83, 61))
    away = looking([x + 1.0, y, 1.0], [x + 3.0, y + 0.5, 1.0], (40, 33))
    amid = looking([x, y - 0.3, 1.4], [x + 0.6, y + 2.0, 1.2], (47, 35))  # parts behind it
    return {
        "around": make_rig(SceneConfig(cameras=3, size=(101, 77), seed=2)),
        "near": CameraRig((near,)),
        "turned away": CameraRig((away,)),
        "amid the body": CameraRig((amid,)),
    }


@pytest.mark.parametrize("case", ["around", "near", "turned away", "amid the body"])
def test_kernel_agrees_with_twin(device: Device, case: str) -> None:
    gait = Gait(Walk.varied(2, 1.7))
    motion = gait.motion(np.array([0.0, 0.37]))
    flesh = Flesh(gait.skeleton)
    rig = rigs(motion.positions[1, 0])[case]
    primitives = flesh.packed(motion, 1)
    balls = flesh.balls(primitives)
    renderer = Renderer(device, rig, make_furniture(2), 2, len(primitives), len(balls))
    renderer(primitives, balls, motion.positions[1, 0, :2])
    masks, depths = renderer.mask.get(), renderer.depth.get()
    assert np.isfinite(renderer.picture.get()).all()
    for camera, mask, depth in zip(rig, masks, depths, strict=True):
        true_mask, true_depth = silhouette(camera, primitives)
        if case == "turned away":
            assert not true_mask.any()
        else:
            assert 0.01 < (true_mask > 0).mean() < 0.95
        # Rays that graze the surface end on either side of the threshold.
        assert (mask != true_mask).mean() <= 0.002
        both = (mask > 0) & (true_mask > 0)
        difference = np.abs(depth - true_depth)[both]
        assert (difference > 2e-3).mean() <= 0.02 if both.any() else True
