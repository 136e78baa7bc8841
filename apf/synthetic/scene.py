"""The synthetic scene: cameras around a furnished room, colours, a walk."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from apf.synthetic.config import SceneConfig
from psfs.cameras.camera import Camera, CameraRig

Pair = tuple[float, float]

#: Half width, half depth and height of the room, m.
ROOM = (4.7, 4.9, 4.8)
#: Styles that `box_colour` in scene_room.h implements.
WOOD, CARDBOARD, BOOKS, CLOTH = range(4)

#: Colours, linear BGR, of the shirts and their stripes.
_SHIRTS = (
    ((0.060, 0.085, 0.32), (0.62, 0.64, 0.66)),
    ((0.34, 0.17, 0.06), (0.55, 0.58, 0.60)),
    ((0.10, 0.26, 0.07), (0.50, 0.60, 0.58)),
    ((0.50, 0.52, 0.55), (0.22, 0.09, 0.05)),
    ((0.09, 0.35, 0.52), (0.10, 0.09, 0.09)),
)


@dataclass(frozen=True, eq=False)
class Furniture:
    """The objects in the room and on its walls, packed for scene.cl.

    boxes: (B, 8) float32 low xyz, high xyz (m), style, hue. posters: (N, 8) float32 wall 0-3,
    centre along the wall, centre height, half width, half height (m), style, hue, 0. palette: (9,
    3) float32 linear BGR per region of the body, then the shirt's second colour.
    """

    boxes: np.ndarray
    posters: np.ndarray
    palette: np.ndarray


def make_rig(config: SceneConfig) -> CameraRig:
    """Place cameras on a ring of about 4 m, 1.7-2.6 m high, looking at the centre at about 1 m."""
    rng = np.random.default_rng([config.seed, 2])
    start = rng.uniform(0.0, 2 * np.pi)  # as of straight walks
    spacing = 2 * np.pi / config.cameras
    heights = np.linspace(1.75, 2.55, config.cameras)[rng.permutation(config.cameras)]
    cameras = []
    for i in range(config.cameras):
        bearing = start + spacing * (i + rng.uniform(-0.08, 0.08))
        radius = rng.uniform(3.95, 4.3)
        centre = np.array(
            [
                radius * np.cos(bearing),
                radius * np.sin(bearing),
                heights[i] + rng.uniform(-0.05, 0.05),
            ]
        )
        target = np.array([0.0, 0.0, 0.95]) + rng.uniform(-0.08, 0.08, 3)
        cameras.append(_make_camera(f"cam{i + 1:02d}", centre, target, config.size, rng))
    return CameraRig(tuple(cameras))


def _make_camera(
    name: str,
    centre: np.ndarray,
    target: np.ndarray,
    size: tuple[int, int],
    rng: np.random.Generator,
) -> Camera:
    import cv2  # takes a while to load

    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    roll = math.radians(rng.uniform(-1.2, 1.2))
    down = np.cross(forward, right)
    right, down = (
        math.cos(roll) * right + math.sin(roll) * down,
        math.cos(roll) * down - math.sin(roll) * right,
    )
    R = np.stack([right, down, forward])
    # Convert to a Rodrigues vector and back, so that the rendered rotation is exactly the written
    # one.
    R = cv2.Rodrigues(np.round(cv2.Rodrigues(R)[0].ravel(), 10))[0]
    focal = 600.0 / 640.0 * max(size[0], size[1] * 4 / 3) * rng.uniform(0.98, 1.02)
    offset = rng.uniform(-0.01, 0.01, 2) * size
    K = np.array(
        [
            [focal, 0.0, round((size[0] - 1) / 2 + offset[0], 6)],
            [0.0, focal * rng.uniform(0.998, 1.002), round((size[1] - 1) / 2 + offset[1], 6)],
            [0.0, 0.0, 1.0],
        ]
    )
    distortion = np.round(
        [rng.uniform(-0.10, -0.05), rng.uniform(0.01, 0.02), *rng.uniform(-4e-4, 4e-4, 2), 0.0], 8
    )
    return Camera(name, np.round(K, 8), distortion, R, np.round(-R @ centre, 10), size)


def make_furniture(seed: int) -> Furniture:
    """Furnish a room and dress a person at random."""
    rng = np.random.default_rng([seed, 3])
    boxes = []
    for wall in range(4):
        boxes += _furnish_wall(wall, rng)
    posters = [row for wall in range(4) for row in _make_posters(wall, rng)]
    return Furniture(np.array(boxes, np.float32), np.array(posters, np.float32), _make_palette(rng))


def _furnish_wall(wall: int, rng: np.random.Generator) -> list[list[float]]:
    """Place furniture at one wall, low enough for the cameras to look over it."""
    reach, side = (ROOM[0], ROOM[1]) if wall % 2 == 0 else (ROOM[1], ROOM[0])
    out = []

    def put(along: float, size: Pair, height: Pair, style: int, *,
            hue: float = 0.0, gap: float = 0.02) -> None:  # fmt: skip
        (width, depth), (low, high) = size, height
        near, far = reach - gap - depth, reach - gap
        if wall >= 2:
            near, far = -far, -near
        x0, x1, y0, y1 = near, far, along - width / 2, along + width / 2
        if wall % 2 == 1:
            x0, x1, y0, y1 = y0, y1, x0, x1
        out.append([x0, y0, low, x1, y1, high, style, hue])

    middle = rng.uniform(-0.6, 0.6)
    if wall == 0:  # a sofa
        hue = rng.uniform()
        put(middle, (1.9, 0.80), (0.0, 0.42), CLOTH, hue=hue)
        put(middle, (1.9, 0.22), (0.42, 0.82), CLOTH, hue=hue)
        for end in (-1.0, 1.0):
            put(middle + end * 0.95, (0.20, 0.80), (0.0, 0.60), CLOTH, hue=hue)
    elif wall == 1:  # book shelves
        put(middle - 0.7, (1.0, 0.28), (0.0, 1.40), BOOKS)
        put(middle + 0.5, (1.0, 0.28), (0.0, 1.06), BOOKS)
    elif wall == 2:  # a cupboard with boxes on it
        put(middle, (1.6, 0.50), (0.0, 0.80), WOOD)
        put(middle - 0.4, (0.42, 0.34), (0.80, 1.06), CARDBOARD, gap=0.08)
    else:  # a table
        put(middle, (1.4, 0.75), (0.70, 0.75), WOOD)
        for end in (-1.0, 1.0):
            put(middle + end * 0.62, (0.06, 0.65), (0.0, 0.70), WOOD, gap=0.07)
    corner = side - rng.uniform(0.55, 0.8)
    size = rng.uniform(0.45, 0.65)
    put(corner, (size, size * 0.9), (0.0, size * 0.8), CARDBOARD, gap=0.15)
    smaller = (size * 0.6, size * 0.5)
    put(corner + 0.03, smaller, (size * 0.8, size * 1.25), CARDBOARD, gap=0.22)
    return out


def _make_posters(wall: int, rng: np.random.Generator) -> list[list[float]]:
    side = ROOM[1] if wall % 2 == 0 else ROOM[0]
    rows: list[list[float]] = []
    for slot in np.linspace(-0.68, 0.68, 4):
        half_width, half_height = rng.uniform(0.28, 0.62), rng.uniform(0.30, 0.52)
        middle = slot * side + rng.uniform(-0.15, 0.15)
        height = rng.uniform(1.75, 2.05)
        rows.append(
            [wall, middle, height, half_width, half_height, int(rng.integers(4)), rng.uniform(), 0]
        )
    return rows


def make_palettes(seed: int, people: int) -> list[np.ndarray]:
    """Choose the colours (9, 3) of each of several people, whose shirts differ as far as there are
    different ones; the first person's are those of the furniture."""
    first = make_furniture(seed).palette
    rngs = [np.random.default_rng([seed, 7, number]) for number in range(1, people)]
    worn = next(k for k, (shirt, _) in enumerate(_SHIRTS) if np.allclose(shirt, first[0]))
    return [first, *(_make_palette(rng, worn + k) for k, rng in enumerate(rngs, start=1))]


def _make_palette(rng: np.random.Generator, shirt_number: int | None = None) -> np.ndarray:
    """Choose linear BGR per region (the order of body.py), then the shirt's stripes."""
    trousers = (
        (0.145, 0.080, 0.048),
        (0.060, 0.058, 0.062),
        (0.13, 0.20, 0.26),
        (0.10, 0.13, 0.11),
    )
    skins = ((0.25, 0.36, 0.62), (0.17, 0.27, 0.48), (0.08, 0.14, 0.28))
    hairs = ((0.018, 0.024, 0.035), (0.030, 0.055, 0.10), (0.10, 0.20, 0.32))
    number = int(rng.integers(len(_SHIRTS))) if shirt_number is None else shirt_number
    shirt, stripes = _SHIRTS[number % len(_SHIRTS)]
    rows = [
        shirt,
        trousers[rng.integers(len(trousers))],
        skins[rng.integers(len(skins))],
        hairs[rng.integers(len(hairs))],
        (0.050, 0.045, 0.050),  # shoes
        (0.45, 0.46, 0.47),  # socks
        (0.50, 0.52, 0.53),  # soles
        (0.03, 0.03, 0.03),  # eyes
        stripes,
    ]
    return np.array(rows, np.float32)
