"""The renderer's kernel and its NumPy twin see the same silhouette and depth, on every device."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import scenes
from helpers.parity import traced

from apf.reference.synthetic.room import empty_room
from apf.reference.synthetic.scene import FOUR, floor_shadow, shadowed_room, silhouette
from apf.synthetic.body import PersonSurface
from apf.synthetic.gait import GaitModel
from apf.synthetic.render import SHADOW_SIZE, SHADOW_STEP, TILE, SceneRenderer
from apf.synthetic.scene import SceneConfig, make_furniture, make_rig
from apf.synthetic.walk import Walk
from cl import Device
from psfs.cameras.camera import Camera, CameraRig


def looking(centre: list[float], target: list[float], size: tuple[int, int]) -> Camera:
    view = scenes.pinhole("one", centre, target, size, 0.9 * max(size))
    K = np.add(view.K, [[0, 0.5, 0], [0, 0, 0], [0, 0, 0]])
    return replace(view, K=K, distortion=np.array([-0.1, 0.02, 1e-3, -1e-3, 0.01]))


def rig_of(case: str, pelvis: np.ndarray) -> CameraRig:
    """Two cameras, or one: near, turned away, amid the body with parts behind it, or of few rays
    for a simulator."""
    if case == "around":
        return make_rig(SceneConfig(cameras=2, size=(60, 46), seed=2))
    x, y = pelvis[:2]
    view = {
        "near": ([x + 0.9, y + 0.5, 1.3], [x, y, 1.1], (59, 43)),
        "turned away": ([x + 1.0, y, 1.0], [x + 3.0, y + 0.5, 1.0], (40, 33)),
        "amid the body": ([x, y - 0.3, 1.4], [x + 0.6, y + 2.0, 1.2], (47, 35)),
        "small": ([x + 0.9, y + 0.5, 1.3], [x, y, 1.1], (45, 8)),
    }[case]
    return CameraRig((looking(*view),))


def drawn(
    device: Device, case: str, shadow: float = 1.0
) -> tuple[CameraRig, SceneRenderer, np.ndarray]:
    """The rig, a renderer that has drawn the walker, and his primitives."""
    gait = GaitModel(Walk.sample(2, 1.7))
    motion = gait.motion(np.array([0.0, 0.37]))
    flesh = PersonSurface(gait.skeleton)
    rig = rig_of(case, motion.positions[1, 0])
    primitives = flesh.packed(motion, 1)
    balls = flesh.balls(primitives)
    room = (make_furniture(2), 2)
    renderer = SceneRenderer(device, rig, *room, len(primitives), len(balls), shadow=shadow)
    renderer(primitives, balls, motion.positions[1, 0, :2])
    return rig, renderer, primitives


CASES = ["around", "turned away", "amid the body", "small"]


@pytest.mark.parity("synthetic/scene.render")
@pytest.mark.parametrize("case", CASES)
def test_kernel_agrees_with_twin(device: Device, case: str) -> None:
    rig, renderer, primitives = drawn(device, case)
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


@pytest.mark.parity("synthetic/scene.empty_room")
@pytest.mark.parametrize("case", ["around", "small"])
def test_the_empty_room_agrees_with_its_twin(device: Device, case: str) -> None:
    with traced("synthetic/scene.empty_room") as launches:
        rig, _, _ = drawn(device, case)
    found, furniture = launches[0].after, make_furniture(2)
    for view, camera in enumerate(rig):
        picture, distance, floor = empty_room(camera, furniture.posters, furniture.boxes, 2)
        # Rays that graze an edge end on either side of it; so do those at the rim of a colour.
        assert picture.std() > 10
        assert (np.abs(found["colours"][view] - picture).max(-1) < 0.5).mean() > 0.98
        assert np.isclose(found["distance"][view], distance, rtol=1e-4).mean() > 0.995
        assert np.isclose(found["floor_point"][view], floor, rtol=1e-3, atol=1e-3).mean() > 0.995


@pytest.mark.parity("synthetic/scene.floor_shadow")
def test_the_shadow_agrees_with_its_twin(device: Device) -> None:
    with traced("synthetic/scene.floor_shadow") as launches:
        drawn(device, "small")
        drawn(device, "small", shadow=0.2)
    for launch, strength, darkest in zip(launches, (1.0, 0.2), (0.1, 0.85), strict=True):
        balls, centre = launch.before["balls"], launch.before["centre"]
        expected = floor_shadow(balls, centre, SHADOW_SIZE, SHADOW_STEP, strength)
        assert darkest < expected.min() < darkest + 0.7 and expected.max() == 1
        np.testing.assert_allclose(launch.after["shadow"], expected, atol=1e-3)


@pytest.mark.parity("synthetic/scene.bin_primitives")
@pytest.mark.parametrize("case", CASES)
def test_tiles_list_what_their_rays_meet(device: Device, case: str) -> None:
    """Each primitive that a ray of the tile meets alone, each once, in order; not all of them."""
    with traced("synthetic/scene.bin_primitives") as launches:
        rig, _, primitives = drawn(device, case)
    tiles = launches[0].after["tiles"]
    met = 0
    for view, camera in enumerate(rig):
        for k, primitive in enumerate(primitives):
            mask = silhouette(camera, primitive[None])[0]
            for j, i in np.ndindex(*tiles.shape[1:3]):
                if mask[j * TILE : (j + 1) * TILE, i * TILE : (i + 1) * TILE].any():
                    count, *listed = tiles[view, j, i]
                    assert k in listed[:count]
                    met += 1
    counts = tiles[..., 0]
    for count, *listed in tiles.reshape(-1, tiles.shape[-1]):
        assert (np.diff(listed[:count]) > 0).all()
    assert counts.sum() >= met and (met == 0) == (case == "turned away")
    assert counts.mean() < 0.7 * len(primitives)


@pytest.mark.parity("synthetic/scene.smooth_edges")
@pytest.mark.parametrize("case", ["near", "small"])
def test_smooth_edges_agree_with_their_twin(device: Device, case: str) -> None:
    """Pixels at the outline show as much of the person as of 2 x 2 rays meet him."""
    with traced("synthetic/scene.smooth_edges") as launches:
        rig, _, primitives = drawn(device, case)
    given, found = launches[0].before, launches[0].after["colours"]
    smoothed = wrong = 0
    for view, camera in enumerate(rig):
        mask, before = given["mask"][view] > 0, given["colours"][view].astype(float)
        padded = np.pad(mask, 1, "edge")
        beside = [padded[1 + y : y - 1 or None, 1 + x : x - 1 or None]
                  for y, x in ((0, 1), (0, -1), (1, 0), (-1, 0))]  # fmt: skip
        edge = np.any([other != mask for other in beside], axis=0)
        np.testing.assert_array_equal(found[view][~edge], given["colours"][view][~edge])
        hits = [silhouette(camera, primitives, given["distance"][view], at)[0] > 0 for at in FOUR]
        share = np.mean(hits, axis=0)[..., None]
        scene = (given[name][view] for name in ("room", "floor_point"))
        behind = shadowed_room(*scene, given["shadow"], given["centre"], SHADOW_STEP)
        # A pixel whose own ray missed takes the colour of another's, which no twin has.
        known = edge & (mask | (share[..., 0] == 0))
        expected = behind + share * (before - behind)
        smoothed += known.sum()
        wrong += (np.abs(found[view] - expected).max(-1) > 1)[known].sum()
    assert smoothed > (10 if case == "small" else 50)
    assert wrong <= 0.05 * smoothed  # rays that graze the surface
