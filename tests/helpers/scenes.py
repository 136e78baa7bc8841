"""Small synthetic scenes for the tests of the reconstruction."""

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from cl import Device
from psfs.background.gaussian import Background
from psfs.calibration.scene import turn_to_up
from psfs.cameras.camera import Camera, CameraRig
from psfs.sequence import Frame
from psfs.voxels.bricks import Bricks
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.sparse import SparseSurface


def frame(
    index: int = 0, images: np.ndarray | None = None, masks: np.ndarray | None = None
) -> Frame:
    return Frame(index, images, masks)


def rotation_towards(direction: np.ndarray, up: npt.ArrayLike = (0, 0, 1.0)) -> np.ndarray:
    """Return the rotation (3, 3) of an upright camera that looks along a direction (3,)."""
    return turn_to_up(direction, np.cross(direction, up))


def pinhole(
    name: str, centre: npt.ArrayLike, target: npt.ArrayLike, size: tuple[int, int], focal: float
) -> Camera:
    """Return an upright camera without distortion."""
    R = rotation_towards(np.subtract(target, centre))
    K = np.array([[focal, 0, size[0] / 2], [0, focal, size[1] / 2], [0, 0, 1]])
    return Camera(name, K, np.zeros(5), R, -R @ centre, size)


def pinholes(
    places: Iterable[tuple[float, float, float]],
    target: npt.ArrayLike,
    size: tuple[int, int],
    focal: float,
) -> list[Camera]:
    """Return such cameras c0, c1, ... at azimuth, rad, distance from the z axis and height, m."""
    centres = [(away * np.cos(turn), away * np.sin(turn), height) for turn, away, height in places]
    return [pinhole(f"c{k}", centre, target, size, focal) for k, centre in enumerate(centres)]


def looking_at(
    name: str, centre: np.ndarray, target: np.ndarray, size: tuple[int, int], focal: float
) -> Camera:
    """Return a camera that leans and distorts."""
    R = rotation_towards(np.subtract(target, centre), up=(0.1, 0.0, 1.0))
    K = np.array([[focal, 0, size[0] / 2], [0, focal * 1.02, size[1] / 2], [0, 0, 1.0]])
    distortion = np.array([-0.12, 0.04, 0.001, -0.002, 0.01])
    return Camera(name, K, distortion, R, -R @ np.asarray(centre, float), size)


def ring(views: int = 4, size: tuple[int, int] = (97, 75), radius: float = 3.0) -> CameraRig:
    """Return cameras of different odd sizes around the vertical axis at about eye level."""
    cameras = []
    for k in range(views):
        angle = 2 * np.pi * k / max(views, 1) + 0.3
        centre = np.array([radius * np.cos(angle), radius * np.sin(angle), 1.2 + 0.2 * k])
        here = (size[0] - 7 * (k % 2), size[1] - 4 * (k % 3))
        cameras.append(looking_at(f"c{k}", centre, np.array([0, 0, 0.8]), here, size[0] * 0.9))
    return CameraRig(tuple(cameras))


#: Corners (8, 3), m, of a block of a person's height.
BLOCK = np.stack(np.meshgrid([-0.2, 0.2], [-0.15, 0.15], [0.1, 1.7]), -1).reshape(-1, 3)


def draw_hull(camera: Camera, points: np.ndarray, level: int = 255) -> np.ndarray:
    """Return the mask (h, w) uint8 of the convex hull of points (N, 3)."""
    mask = np.zeros(camera.size[::-1], np.uint8)
    hull = cv2.convexHull(np.rint(camera.project(points)[0]).astype(np.int32))
    return cv2.fillConvexPoly(mask, hull, level)


def draw_points(camera: Camera, points: np.ndarray, width: int = 1) -> np.ndarray:
    """Return the mask (h, w) uint8 of points (N, 3), each a square so many pixels wide."""
    mask = np.zeros(camera.size[::-1], np.uint8)
    _, row, column, _ = camera.look_up(points)
    mask[row, column] = 255
    return np.asarray(cv2.dilate(mask, np.ones((width, width), np.uint8)))


def without_distortion(rig: CameraRig) -> CameraRig:
    return CameraRig(tuple(replace(camera, distortion=np.zeros(5)) for camera in rig))


def turned(camera: Camera, turn: npt.ArrayLike) -> Camera:
    """Return a camera turned about its centre by a rotation vector (3,)."""
    R = cv2.Rodrigues(np.asarray(turn, float))[0] @ camera.R
    return replace(camera, R=R, t=-R @ camera.centre)


def pixels_apart(a: CameraRig, b: CameraRig, points: np.ndarray) -> float:
    """Return how far apart cameras see points (N, 3), px."""
    pairs = zip(a, b, strict=True)
    return float(np.mean([np.abs(c.project(points)[0] - d.project(points)[0]) for c, d in pairs]))


def small_grid(voxel_size: float = 0.06) -> VoxelGrid:
    return VoxelGrid.covering(np.array([-0.7, -0.6, -0.1]), np.array([0.8, 0.7, 1.9]), voxel_size)


def solid(points: np.ndarray) -> np.ndarray:
    """Return whether points (..., 3) lie in the test body: a ball on a leaning block."""
    ball = ((points - [0.1, 0.0, 1.3]) ** 2).sum(-1) < 0.3**2
    low, high = np.array([-0.2, -0.25, 0.2]), np.array([0.25, 0.15, 1.2])
    return ball | ((points >= low) & (points <= high)).all(-1)


@cache
def solid_points() -> np.ndarray:
    """Return a dense cloud of points (N, 3) of the test body; not to be changed."""
    axes = [np.arange(-0.3, 0.5, 0.012), np.arange(-0.4, 0.4, 0.012), np.arange(0.1, 1.7, 0.012)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return points[solid(points)]


def limbs(frame: float) -> np.ndarray:
    """Points (N, 3) m of a body with arms, which turns and moves them."""
    random = np.random.default_rng(0)
    turn, swing = 0.1 * frame, np.sin(0.3 * frame)
    parts = [
        ([0, 0, 0.9], [0.15, 0.1, 0.6]),
        ([0, 0, 1.6], [0.1, 0.1, 0.15]),
        ([0.35, 0.1, 1.2 + 0.3 * swing], [0.25, 0.05, 0.05]),
        ([-0.35, 0.0, 1.2 - 0.3 * swing], [0.25, 0.05, 0.05]),
        ([0.1, 0.25 * swing, 0.3], [0.06, 0.06, 0.3]),
        ([-0.1, -0.25 * swing, 0.3], [0.06, 0.06, 0.3]),
    ]
    points = np.concatenate([np.array(m) + random.uniform(-1, 1, (400, 3)) * s for m, s in parts])
    c, s = np.cos(turn), np.sin(turn)
    about: np.ndarray = points @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    return about + np.array([0.2 * np.sin(0.05 * frame), 0.2 * np.cos(0.07 * frame), 0])


def masks_of(rig: CameraRig, shift: npt.ArrayLike = (0, 0, 0)) -> np.ndarray:
    """Render silhouettes (V, H, W) uint8 of the shifted test body from a dense cloud of points."""
    masks = np.zeros((len(rig), rig.height, rig.width), np.uint8)
    for mask, camera in zip(masks, rig, strict=True):
        mask[: camera.size[1], : camera.size[0]] = draw_points(camera, solid_points() + shift)
    return masks


def pictures_of(rig: CameraRig, seed: int = 0) -> tuple[Frame, Background]:
    """Return a noisy picture of the test body before a textured background, and that background."""
    random = np.random.default_rng(seed)
    shape = (len(rig), rig.height, rig.width, 3)
    mean = random.uniform(20, 230, shape).astype(np.float32)
    std = random.uniform(0.5, 6, shape).astype(np.float32)
    masks = masks_of(rig)
    images = np.where(masks[..., None] > 0, 128.0, mean + random.normal(0, 2, shape))
    pictures = np.clip(images, 0, 255).astype(np.uint8)
    return frame(images=pictures, masks=masks), Background(mean, std)


def voxels_at(device: Device, grid: VoxelGrid, indices: np.ndarray) -> Any:
    """As much of `Voxels` as those need who look at the surface; what is beyond the count is
    stale."""
    listed = np.full(grid.size, grid.size - 1, np.int32)
    listed[: len(indices)] = indices
    count = np.array([len(indices)], np.int32)
    return SimpleNamespace(
        grid=grid, surface=device.to_device(listed), count=device.to_device(count), evidence=None,
        pictures=lambda: None,
    )  # fmt: skip


#: With it no brick of voxels is left out, so that all can be compared with the twin.
ALL_BRICKS = OccupancyConfig(threshold=1e-9)


def carve(bricks: Bricks) -> np.ndarray:
    """Smoothed probability (nx, ny, nz)."""
    surface = SparseSurface(bricks)
    surface()
    return surface.probability.get()


def patches_of_evidence(
    rig: CameraRig, seed: int, block: int, below: int = 15, plain: float = 0.0
) -> np.ndarray:
    """(V, H, W) int8, anything from -127 on in blocks of pixels, since where rounding decides
    between two pixels they then seldom differ; the share `plain` of blocks is background."""
    random = np.random.default_rng(seed)
    shape = (len(rig), rig.height // block + 1, rig.width // block + 1)
    coarse = random.integers(-127, below, shape)
    coarse = np.where(random.random(shape) < plain, -60, coarse)
    fine = coarse.repeat(block, 1).repeat(block, 2)
    return fine[:, : rig.height, : rig.width].astype(np.int8)
