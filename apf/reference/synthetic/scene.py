"""NumPy twin of the synthetic renderer's core (synthetic/scene.cl): silhouette, depth and shadow.

Plain sphere tracing of all primitives for every pixel, in float64, with no culling: what the
kernel's tiles and lists must not change.
"""

from __future__ import annotations

import numpy as np
import scipy

from apf.synthetic.render import FAR, HIT, MARCH_STEPS
from psfs.cameras.camera import Camera

#: x, y, z in m and strength of the two lamps, and their radius, m.
LAMPS = np.array([[1.6, -1.9, 4.6, 0.56], [-2.1, 1.4, 4.3, 0.36]])
LAMP_RADIUS = 0.32
#: Where rays cross a pixel, px from its centre, where 2 x 2 are traced.
FOUR = ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25))


def camera_rays(
    camera: Camera, offset: tuple[float, float] = (0.0, 0.0)
) -> tuple[np.ndarray, np.ndarray]:
    """Return unit rays (H, W, 3) in the world through the pixels, `offset` px from their centres,
    and depth per length (H, W)."""
    width, height = camera.size
    u, v = np.meshgrid(np.arange(width) + offset[0], np.arange(height) + offset[1])
    yd = (v - camera.K[1, 2]) / camera.K[1, 1]
    xd = (u - camera.K[0, 2] - camera.K[0, 1] * yd) / camera.K[0, 0]
    k1, k2, p1, p2, k3 = camera.distortion
    x, y = xd, yd
    for _ in range(10):
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        tx = 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        ty = p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        x, y = (xd - tx) / radial, (yd - ty) / radial
    scale = 1 / np.sqrt(x * x + y * y + 1)
    return scale[..., None] * (np.stack([x, y, np.ones_like(x)], -1) @ camera.R), scale


def body_distance(primitives: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the signed distance (N,) m of points (N, 3) to the packed primitives (P, 32)."""
    primitives = primitives.astype(np.float64)
    total = np.full(len(points), FAR)
    for group in np.unique(primitives[:, 19]):
        part = np.full(len(points), FAR)
        for primitive in primitives[primitives[:, 19] == group]:
            part = _smooth_min(part, _primitive_distance(primitive, points), primitive[18])
        total = np.minimum(total, part)
    return total


def silhouette(
    camera: Camera,
    primitives: np.ndarray,
    limit: np.ndarray | float = FAR,
    offset: tuple[float, float] = (0.0, 0.0),
) -> tuple[np.ndarray, np.ndarray]:
    """Return the mask (H, W) uint8 0/255 and the depth (H, W) m (0 = missed) of the body described
    by packed primitives; nothing is seen farther along a ray than `limit` (H, W) m. The rays cross
    the pixels `offset` px from their centres."""
    rays, scale = camera_rays(camera, offset)
    shape = scale.shape
    rays, scale = rays.reshape(-1, 3), scale.ravel()
    limit = np.broadcast_to(limit, shape).ravel()
    spheres = primitives[:, 20:24].astype(np.float64)
    away = np.linalg.norm(spheres[:, :3] - camera.centre, axis=1)
    t = np.full(len(rays), max(0.0, float((away - spheres[:, 3]).min()) - 0.1))
    far = np.minimum(limit, float((away + spheres[:, 3]).max()) + 0.1)
    hit = np.zeros(len(rays), bool)
    active = np.flatnonzero(t < far)
    for _ in range(2 * MARCH_STEPS):  # the kernel starts nearer to the body
        d = body_distance(primitives, camera.centre + t[active, None] * rays[active])
        hit[active] = d < HIT
        t[active] += np.where(d < HIT, 0.0, np.maximum(0.9 * d, 0.5 * HIT))
        active = active[(d >= HIT) & (t[active] < far[active])]
        if not active.size:
            break
    depth = np.where(hit, t * scale, 0.0)
    return (255 * hit.astype(np.uint8)).reshape(shape), depth.reshape(shape)


def _smooth_min(a: np.ndarray, b: np.ndarray, k: float) -> np.ndarray:
    h = np.maximum(k - np.abs(a - b), 0.0) / k
    return np.minimum(a, b) - 0.25 * h * h * k


def _primitive_distance(primitive: np.ndarray, points: np.ndarray) -> np.ndarray:
    x, y, z = (points @ primitive[:9].reshape(3, 3).T + primitive[9:12]).T
    rho = np.sqrt(x * x + y * y)
    nearest = np.clip(z + primitive[15] * rho, 0.0, primitive[12])
    length = np.hypot(rho, z - nearest)
    slope = np.sqrt((x * primitive[16]) ** 2 + (y * primitive[17]) ** 2 + (z - nearest) ** 2)
    squash = np.where(slope > 1e-6, length / np.maximum(slope, 1e-6), 1.0)
    return (length - (primitive[13] + primitive[14] * nearest)) * squash


def floor_shadow(
    balls: np.ndarray, centre: np.ndarray, size: int, step: float, strength: float = 1.0
) -> np.ndarray:
    """Return (size, size) factors of the floor's grey levels in the shadow of balls (S, 4), x y z
    and radius in m; texels of `step` m around `centre` (2,). strength: 0 for no shadow."""
    half = 0.5 * (size - 1)
    j, i = np.indices((size, size)) - half
    p = np.stack([centre[0] + step * i, centre[1] + step * j, np.zeros_like(i)], -1)
    to = LAMPS[:, None, None, :3] - p
    away = np.linalg.norm(to, axis=-1)
    to /= away[..., None]
    light = LAMPS[:, None, None, 3] * to[..., 2] * 26 / (away**2 + 8)
    covered, seen = np.zeros((size, size)), np.ones((2, size, size))
    for *ball, radius in balls.astype(np.float64):
        c = ball - p
        square = (c**2).sum(-1)
        d2 = np.maximum(square, radius**2)
        covered += 0.45 * radius**2 * np.maximum(c[..., 2], 0) / d2**1.5
        at = (c * to).sum(-1)
        off = np.sqrt(np.maximum(square - at**2, 0)) - radius
        blur = 0.012 + LAMP_RADIUS * at / away
        seen = np.where(at > 0, np.minimum(seen, smoothstep(-blur, blur, off)), seen)
    full = 0.8 + light.sum(0)
    factor = (0.8 * np.exp(-covered) + (light * seen).sum(0)) / full
    rim = smoothstep(0.85, 0.99, np.maximum(np.abs(i), np.abs(j)) / half)
    shadow: np.ndarray = np.sqrt(factor) * (1 - rim) + rim
    return 1 - strength * (1 - shadow)


def shadowed_room(
    room: np.ndarray, floor_point: np.ndarray, shadow: np.ndarray, centre: np.ndarray, step: float
) -> np.ndarray:
    """Return the room's picture (H, W, 3) under the person's shadow, linear between the texels."""
    last = len(shadow) - 1
    x, y = np.moveaxis((floor_point.astype(np.float64) - centre) / step + 0.5 * last, -1, 0)
    inside = (x >= 0) & (y >= 0) & (x < last) & (y < last)
    factor = scipy.ndimage.map_coordinates(shadow, [y, x], order=1, mode="nearest")
    return room * np.where(inside, factor, 1.0)[..., None]


def smoothstep(low: np.ndarray | float, high: np.ndarray | float, x: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.clip((x - low) / (np.asarray(high) - low), 0, 1)
    return t * t * (3 - 2 * t)
