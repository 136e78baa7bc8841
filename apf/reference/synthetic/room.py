"""NumPy twin of the synthetic scene's empty room (synthetic/scene_room.h, scene_noise.h).

All colours are linear BGR (N, 3) of N points at once; `empty_room` makes pictures of them.
"""

from __future__ import annotations

import numpy as np

from apf.reference.synthetic.scene import FOUR, LAMPS, camera_rays, smoothstep
from apf.synthetic.render import FAR
from apf.synthetic.scene import ROOM
from psfs.cameras.camera import Camera


def empty_room(
    camera: Camera, posters: np.ndarray, boxes: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the picture (H, W, 3) in grey levels, 2 x 2 rays per pixel, the distance (H, W) m of
    the last of them, and their mean point (H, W, 2) m on the floor, FAR where one is not on it."""
    shape = camera.size[::-1]
    picture, floor = np.zeros((*shape, 3)), np.zeros((*shape, 2))
    posters, boxes = posters.astype(np.float64), boxes.astype(np.float64)
    for offset in FOUR:
        rays = camera_rays(camera, offset)[0].reshape(-1, 3)
        colour, t, on_floor = room_colour(camera.centre, rays, posters, boxes, seed)
        point = camera.centre + t[:, None] * rays
        picture += 0.25 * colour.reshape(*shape, 3)
        floor += 0.25 * np.where(on_floor[:, None], point[:, :2], FAR).reshape(*shape, 2)
    return picture, t.reshape(shape), floor


def room_colour(
    origin: np.ndarray, rays: np.ndarray, posters: np.ndarray, boxes: np.ndarray, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the grey levels (N, 3) of what rays hit in the room, its distance (N,) m, and whether
    (N,) it is the floor."""
    half = np.array([ROOM[0], ROOM[1], 0.5 * ROOM[2]])
    far = (np.copysign(half, rays) - (origin - [0, 0, half[2]])) / rays
    t, n = far.min(1), np.zeros(rays.shape)
    axis, every = far.argmin(1), np.arange(len(rays))
    n[every, axis] = -np.sign(rays[every, axis])
    hit = np.full(len(rays), -1)
    for i, box in enumerate(boxes):
        low, high = (box[:3] - origin) / rays, (box[3:6] - origin) / rays
        first, last = np.minimum(low, high), np.maximum(low, high)
        enter = first.max(1)
        met = (enter <= last.min(1)) & (enter > 0) & (enter < t)
        t, hit, axis = np.where(met, enter, t), np.where(met, i, hit), first.argmax(1)
        faced = np.zeros(rays.shape)
        faced[every, axis] = -np.sign(rays[every, axis])
        n[met] = faced[met]
    p = origin + t[:, None] * rays
    on_floor = (hit < 0) & (n[:, 2] > 0.5)
    colour, opening = np.full(rays.shape, 0.75), np.ones(len(rays))  # the ceiling's
    colour[on_floor] = floor_colour(p[on_floor, 0], p[on_floor, 1], seed)
    opening[on_floor] = floor_openness(boxes, p[on_floor, 0], p[on_floor, 1])
    for i, box in enumerate(boxes):
        rows = hit == i
        colour[rows] = box_colour(box, p[rows], n[rows], seed + 50 * i)
        opening[rows] = 1 - 0.35 * np.exp(-6 * p[rows, 2])
    for wall, (across, along, sign) in enumerate([(0, 1, 1), (1, 0, 1), (0, 1, -1), (1, 0, -1)]):
        rows = (hit < 0) & (sign * n[:, across] > 0.5)
        colour[rows] = wall_colour(wall, p[rows, along], p[rows, 2], posters, seed)
        corner = ROOM[along] - np.abs(p[rows, along])
        opening[rows] = 1 - 0.35 * np.exp(-5 * p[rows, 2]) - 0.25 * np.exp(-4 * corner)
    linear = colour * lighting(p, n, opening)[:, None]
    return 255 * np.sqrt(np.clip(linear / (1 + 0.18 * linear), 0, 1)), t, on_floor


def lighting(p: np.ndarray, n: np.ndarray, opening: np.ndarray) -> np.ndarray:
    """Return the light (N,) of both lamps and of the room; `opening` dims the latter."""
    light = opening * (0.58 + 0.22 * n[:, 2])
    for *lamp, strength in LAMPS:
        to = lamp - p
        d2 = (to**2).sum(1)
        light += strength * np.maximum((n * to).sum(1) / np.sqrt(d2), 0) * 26 / (d2 + 8)
    return light


def floor_colour(x: np.ndarray, y: np.ndarray, seed: int) -> np.ndarray:
    """Return a woven rug, turned a little, on oak planks, of which every row is shifted."""
    rx, ry = 0.94 * x + 0.34 * y - 0.35, -0.34 * x + 0.94 * y + 0.25
    edge = np.maximum(np.abs(rx) - 1.25, np.abs(ry) - 0.85)
    wool = 0.75 + 0.5 * fractal_noise(rx * 60, ry * 60, seed)
    diamonds = sum(np.abs(np.abs(r) * 2.6 % 1 - 0.5) for r in (rx, ry))
    red, sand, blue = (0.075, 0.065, 0.26), (0.26, 0.36, 0.44), (0.22, 0.11, 0.06)
    rug = select_colours((diamonds < 0.32, sand), (diamonds < 0.52, blue), (True, red), like=x)
    border = (edge > -0.05) | (edge < -0.11)
    rug = np.where(
        (edge > -0.14)[:, None], select_colours((border, sand), (True, blue), like=x), rug
    )

    row = np.floor(y / 0.16)
    shifted = x / 1.7 + noise_hash(row, 3, seed)
    column = np.floor(shifted)
    shade = noise_hash(row, column, seed + 1)
    grain = fractal_noise(x * 3 + 17 * shade, y * 55, seed + 2)
    v, u = y / 0.16 - row, shifted - column
    gap = np.minimum(np.minimum(v, 1 - v) * 0.16, np.minimum(u, 1 - u) * 1.7)
    oak = mix(np.array([0.075, 0.16, 0.29]), np.array([0.15, 0.27, 0.43]), shade)
    planks = oak * ((0.62 + 0.62 * grain) * np.where(gap < 0.003, 0.35, 1.0))[:, None]
    return np.where((edge < 0)[:, None], rug * wool[:, None], planks)


def floor_openness(boxes: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return how open (N,) the floor is between the walls and the boxes that stand on it."""
    opening = (
        1 - 0.3 * np.exp(-4 * (ROOM[0] - np.abs(x))) - 0.3 * np.exp(-4 * (ROOM[1] - np.abs(y)))
    )
    for b in boxes:
        dx = np.maximum(np.maximum(b[0] - x, x - b[3]), 0)
        dy = np.maximum(np.maximum(b[1] - y, y - b[4]), 0)
        opening = opening * (1 - 0.55 * np.exp(-(7 / (0.3 + b[5])) * np.hypot(dx, dy)))
    return opening


def wall_colour(
    wall: int, along: np.ndarray, z: np.ndarray, posters: np.ndarray, seed: int
) -> np.ndarray:
    """Return painted plaster, the baseboard, and the posters."""
    plaster = 0.9 + 0.2 * fractal_noise(along * 7, z * 7, seed + wall)
    paint = np.array([0.46, 0.50, 0.48] if wall & 1 else [0.40, 0.50, 0.54]) * plaster[:, None]
    colour = np.where((z < 0.11)[:, None], [0.55, 0.58, 0.60], paint)
    for i, q in reversed(list(enumerate(posters))):  # the first of those that overlap counts
        u, v = along - q[1], z - q[2]
        edge = np.minimum(q[3] - np.abs(u), q[4] - np.abs(v))
        on = (edge > 0) & (int(q[0]) == wall)
        colour[on] = poster_colour(u[on] / q[3], v[on] / q[4], edge[on], q[5], q[6], seed + i)
    return colour


def poster_colour(
    u: np.ndarray, v: np.ndarray, edge: np.ndarray, style: float, hue: float, seed: int
) -> np.ndarray:
    """Return a picture in a frame: u, v (N,) in [-1, 1], edge (N,) m from the frame's rim."""
    one, two = hue_colour(hue, 0.65, 0.55), hue_colour((hue + 0.45) % 1, 0.5, 0.30)
    n = fractal_noise(3 * u + 7, 3 * v, seed)
    if style < 1:  # hills under a sky
        sky = mix(one, np.full(3, 0.7), 0.3 * (v + 1))
        picture = np.where((v < 0.9 * n - 0.45)[:, None], two * (0.5 + n)[:, None], sky)
    elif style < 2:  # discs
        picture = select_colours((np.hypot(u, v) * 3.2 % 1 < 0.5, one), (True, two), like=u)
    elif style < 3:  # print
        ink = noise_hash(np.trunc(u * 18), np.trunc(v * 9), seed) > 0.3
        ink &= np.abs(v) * 9 % 1 < 0.55
        lines = select_colours((ink, np.full(3, 0.05)), (True, (0.6, 0.64, 0.66)), like=u)
        picture = np.where((v > 0.35)[:, None], one * (0.6 + 0.8 * n)[:, None], lines)
    else:
        picture = mix(one, two, smoothstep(0.35, 0.6, n))
    frame = (0.03, 0.03, 0.035) if hue < 0.5 else (0.18, 0.28, 0.4)
    mount = select_colours((edge < 0.035, frame), (True, (0.72, 0.76, 0.78)), like=u)
    return np.where((edge < 0.075)[:, None], mount, picture)


def box_colour(box: np.ndarray, p: np.ndarray, n: np.ndarray, seed: int) -> np.ndarray:
    """Return wood, cardboard with tape, shelves full of books, or cloth."""
    low, high, kind = box[:3], box[3:6], box[6]
    x_face, _, z_face = (np.abs(n) > 0.5).T
    across, up = np.where(x_face, p[:, 1], p[:, 0]), np.where(z_face, p[:, 1], p[:, 2])
    grain = fractal_noise(across * 4, up * 40, seed)
    from_side = np.minimum(p - low, high - p)
    from_side[np.arange(len(p)), np.abs(n).argmax(1)] = np.inf
    edge = from_side.min(1)
    if kind < 1:
        wood = mix(np.array([0.06, 0.13, 0.24]), np.array([0.12, 0.22, 0.34]), grain)
        return wood * np.where(edge < 0.02, 0.75, 1.0)[:, None]
    if kind < 2:
        middle = across - 0.5 * np.where(x_face, low[1] + high[1], low[0] + high[0])
        tape, board = (0.33, 0.45, 0.55), (0.16, 0.27, 0.40)
        paper = select_colours((np.abs(middle) < 0.03, tape), (True, board), like=across)
        return paper * (0.85 + 0.3 * grain)[:, None]
    if kind < 3:
        shelf = np.floor((p[:, 2] - low[2]) / 0.34)
        rest = p[:, 2] - low[2] - shelf * 0.34
        book = np.floor(across / 0.045)
        h = noise_hash(book, shelf, seed)
        spine = np.where(across / 0.045 - book < 0.12, 0.4, 1.0)
        backs = (
            np.stack([hue_colour(k * 7.3 % 1, 0.6, 0.08 + 0.35 * k) for k in h]) if len(h) else p
        )
        frame = (edge < 0.03) | z_face | (rest < 0.025)
        above = rest > 0.20 + 0.1 * h
        plank, dark = (0.10, 0.18, 0.27), (0.02, 0.02, 0.025)
        colours = select_colours((frame, plank), (True, dark), like=h)
        return np.where((frame | above)[:, None], colours, backs * spine[:, None])
    cloth = 0.75 + 0.5 * fractal_noise(across * 50, up * 50, seed)
    return hue_colour(box[7], 0.45, 0.25) * cloth[:, None]


def noise_hash(x: np.ndarray, y: np.ndarray | int, z: int) -> np.ndarray:
    """Return numbers in [0, 1) of whole numbers."""
    words = zip((x, y, z), (0x8DA6B343, 0xD8163841, 0xCB1AB31F), strict=True)
    first, second, third = (
        np.asarray(n).astype(np.int64).astype(np.uint32) * np.uint32(k) for n, k in words
    )
    h = first ^ second ^ third
    h = (h ^ (h >> np.uint32(15))) * np.uint32(0x2C1B3C6D)
    h = (h ^ (h >> np.uint32(12))) * np.uint32(0x297A2D39)
    return ((h ^ (h >> np.uint32(15))) & np.uint32(0xFFFFFF)) / 16777216.0


def value_noise(x: np.ndarray, y: np.ndarray, seed: int) -> np.ndarray:
    """Return smooth noise in [0, 1] with unit cells."""
    ix, iy = np.floor(x), np.floor(y)
    u, v = smoothstep(0.0, 1.0, x - ix), smoothstep(0.0, 1.0, y - iy)
    corners = [[noise_hash(ix + i, iy + j, seed) for i in (0, 1)] for j in (0, 1)]
    near, far = (a + (b - a) * u for a, b in corners)
    return near + (far - near) * v


def fractal_noise(x: np.ndarray, y: np.ndarray, seed: int) -> np.ndarray:
    octaves = ((0.55, 1.0), (0.30, 2.1), (0.15, 4.3))
    return np.sum([a * value_noise(f * x, f * y, seed + i) for i, (a, f) in enumerate(octaves)], 0)


def hue_colour(hue: float, saturation: float, value: float) -> np.ndarray:
    """Return a saturated colour (3,)."""
    k = np.abs((hue * 6 + np.array([2.0, 4.0, 0.0])) % 6 - 3) - 1
    return value * (1 - saturation + saturation * np.clip(k, 0, 1))


def mix(a: np.ndarray, b: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return colours (N, 3) between a and b (3,)."""
    return a + (b - a) * share[:, None]


def select_colours(
    *cases: tuple[np.ndarray | bool, np.ndarray | tuple[float, ...]], like: np.ndarray
) -> np.ndarray:
    """Return (N, 3): for each the colour of the first case that is true."""
    masks = [np.broadcast_to(mask, like.shape)[:, None] for mask, _ in cases]
    colours = [np.broadcast_to(np.asarray(colour), (len(like), 3)) for _, colour in cases]
    return np.select(masks, colours)
