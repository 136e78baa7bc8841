"""Render boards and wands into known cameras, as footage to calibrate from."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.distance import pdist
from scipy.spatial.transform import Rotation

from helpers import scenes
from psfs.calibration.scene import rigid_transform, turn_to_up
from psfs.calibration.targets.target import Sighting, Target
from psfs.cameras.camera import Camera

SIZE = (480, 360)
#: Grey level of the scene, and deviation of the pictures' noise.
_SCENE, _NOISE = 90, 3.0
#: White rim of a board, m.
_RIM = 0.06

Pose = np.ndarray


def ring(
    views: int = 6, size: tuple[int, int] = SIZE, focal: float = 380.0, step: float = 60.0
) -> list[Camera]:
    """Return cameras of different focal lengths, `step` degrees apart around the origin, 3 m
    away."""
    cameras = []
    for k in range(views):
        angle = np.radians(step) * k + 0.2
        centre = np.array([3 * np.cos(angle), 3 * np.sin(angle), 1.5 + 0.5 * (k % 2)])
        R = scenes.rotation_towards(np.array([0, 0, 0.8]) - centre)
        f = focal * (1 + 0.02 * (k - 2))
        K = np.array([[f, 0, size[0] / 2 + 3], [0, 1.002 * f, size[1] / 2 - 2], [0, 0, 1]])
        distortion = np.array([-0.1, 0.03, 0.0005, -0.0003, 0])
        cameras.append(Camera(f"cam{k + 1:02d}", K, distortion, R, -R @ centre, size))
    return cameras


def facing(rng: np.random.Generator, towards: np.ndarray, reach: float = 0.6) -> Pose:
    """Return a pose (4, 4), target to world, of a board that roughly faces the point `towards` (3,)
    m."""
    place = np.array([*rng.uniform(-reach, reach, 2), rng.uniform(0.6, 1.6)])
    z = place - towards + rng.normal(0, 0.4, 3)
    return rigid_transform(turn_to_up(z, np.cross(rng.normal(0, 1, 3), z)).T, place)


def anyhow(rng: np.random.Generator, reach: float = 0.7) -> Pose:
    """Return a pose (4, 4) in a random direction."""
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    place = np.array([*rng.uniform(-reach, reach, 2), rng.uniform(0.4, 1.6)])
    return rigid_transform(Q * np.sign(np.linalg.det(Q)), place)


def flat(turn: float, x: float = 0.0, y: float = 0.0) -> Pose:
    """Return a pose (4, 4) of a board that lies face up on the floor: its Z axis points down."""
    c, s = np.cos(turn), np.sin(turn)
    return rigid_transform(np.array([[c, s, 0], [s, -c, 0], [0, 0, -1.0]]), np.array([x, y, 0]))


def board_picture(
    picture: np.ndarray, square: float, squares: tuple[int, int]
) -> Callable[[Camera, Pose, np.random.Generator], np.ndarray]:
    """A renderer of a board whose flat picture (h, w) uint8 is `squares` of `square` m: warped by
    the camera's rays, with blur and noise. The board's origin is its first inner corner if the
    picture is a chessboard's, else its outer corner: pass poses of that."""
    scale = picture.shape[1] / (squares[0] * square)
    known: dict[str, np.ndarray] = {}

    def render(camera: Camera, pose: Pose, rng: np.random.Generator) -> np.ndarray:
        if camera.name not in known:  # one that takes over looks through the same lens
            columns, rows = np.meshgrid(np.arange(camera.size[0]), np.arange(camera.size[1]))
            rays = camera.rays(np.stack([columns.ravel(), rows.ravel()], -1).astype(float))
            known[camera.name] = (rays @ camera.R.T).T.astype(np.float32)
        inverse = np.linalg.inv(pose)
        origin = (inverse[:3, :3] @ camera.centre + inverse[:3, 3]).astype(np.float32)
        ahead = (inverse[:3, :3] @ camera.R.T).astype(np.float32) @ known[camera.name]
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = -origin[2] / ahead[2]
        x, y = (origin[:2, None] + depth * ahead[:2]).reshape(2, *camera.size[::-1])
        shown = cv2.remap(
            picture, x * scale - 0.5, y * scale - 0.5, cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT, borderValue=255,
        )  # fmt: skip
        width, height = square * np.array(squares)
        on = (x > -_RIM) & (x < width + _RIM) & (y > -_RIM) & (y < height + _RIM)
        on &= (depth > 0).reshape(x.shape) & (origin[2] < 0)  # from its front
        image = np.where(on, 40 + 0.7 * shown, _SCENE)
        return finished(image, rng)

    return render


def finished(image: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Add blur and noise to a picture (h, w) uint8."""
    image = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 0.7)
    image += _NOISE * rng.standard_normal(image.shape, np.float32)
    return np.clip(image, 0, 255).astype(np.uint8)


def wand_picture(
    points: np.ndarray, noise: float = 0.3
) -> Callable[[Camera, Pose, np.random.Generator], np.ndarray]:
    """Return a renderer of a wand's markers, with `noise` px of error, and of a lamp that does not
    move."""

    def render(camera: Camera, pose: Pose, rng: np.random.Generator) -> np.ndarray:
        image = np.full(camera.size[::-1], 40.0)
        rows, columns = np.arange(camera.size[1]), np.arange(camera.size[0])
        pixels, _ = camera.project(points @ pose[:3, :3].T + pose[:3, 3])
        for x, y in (*(pixels + rng.normal(0, noise, pixels.shape)), (30.0, 20.0)):
            down, across = (np.exp(-((a - b) ** 2) / 5.0) for a, b in ((rows, y), (columns, x)))
            image += 200 * np.outer(down, across)
        return finished(image, rng)

    return render


def film(
    folder: Path,
    cameras: list[Camera],
    poses: list[Pose],
    render: Callable[[Camera, Pose, np.random.Generator], np.ndarray],
    later: Mapping[int, Camera] | None = None,
    at: int = 0,
    seed: int = 0,
) -> None:
    """Write images/<camera>/NNN.pgm; later: cameras that replace the first ones from frame `at`
    on."""
    rng = np.random.default_rng(seed)
    for frame, pose in enumerate(poses):
        for view, camera in enumerate(cameras):
            used = (later or {}).get(view, camera) if frame >= at else camera
            path = folder / "images" / camera.name / f"{frame:03d}.pgm"
            path.parent.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(path), render(used, pose, rng))


def moved(camera: Camera, by: np.ndarray) -> Camera:
    """Return the camera with its centre moved, m."""
    return replace(camera, t=camera.t - camera.R @ by)


def differences(found: list[Camera], true: list[Camera]) -> tuple[np.ndarray, float]:
    """Return distances (V,) mm between the camera centres after the best rigid alignment, and the
    relative scale error."""
    A, B = (np.stack([camera.centre for camera in rig]) for rig in (found, true))
    a, b = A - A.mean(0), B - B.mean(0)
    turn, _ = Rotation.align_vectors(b, a)
    away = 1000 * np.linalg.norm(turn.apply(a) - b, axis=1)
    return away, float(pdist(A).sum() / pdist(B).sum() - 1)


def sighted(
    target: Target, cameras: list[Camera], poses: list[Pose], noise: float = 0.3, seed: int = 0
) -> list[Sighting]:
    """What cameras see of a target, with noise in px: whole, in the picture, and boards from their
    front; points that look alike are taken in either order."""
    rng, found = np.random.default_rng(seed), []
    for frame, pose in enumerate(poses):
        points = target.points @ pose[:3, :3].T + pose[:3, 3]
        for view, camera in enumerate(cameras):
            pixels, depth = camera.project(points)
            inside = (pixels > 3) & (pixels < np.array(camera.size) - 4) & (depth > 0)[:, None]
            towards = camera.centre - pose[:3, 3]
            oblique = -pose[:3, 2] @ towards < 0.4 * np.linalg.norm(towards)
            if inside.all() and not (target.planar and oblique):
                pixels = pixels + rng.normal(0, noise, pixels.shape)
                order = target.orders[rng.integers(len(target.orders))]
                found.append(Sighting(frame, view, np.arange(len(points))[order], pixels))
    return found


def unplaced(cameras: list[Camera]) -> list[Camera]:
    """Return the cameras with their intrinsics only."""
    return [replace(camera, R=np.eye(3), t=np.zeros(3)) for camera in cameras]
