"""NumPy twin of the synthetic renderer's core (synthetic/scene.cl): silhouette and depth.

Plain sphere tracing of all primitives for every pixel, in float64, with no culling: what the
kernel's tiles and lists must not change.
"""

from __future__ import annotations

import numpy as np

from psfs.cameras.camera import Camera

HIT, MARCH_STEPS, FAR = 5e-4, 64, 1e6


def camera_rays(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Return unit rays (H, W, 3) through the pixel centres in the world, and depth per length
    (H, W)."""
    width, height = camera.size
    u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
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
    camera: Camera, primitives: np.ndarray, limit: np.ndarray | float = FAR
) -> tuple[np.ndarray, np.ndarray]:
    """Return the mask (H, W) uint8 0/255 and the depth (H, W) m (0 = missed) of the body described
    by packed primitives; nothing is seen farther along a ray than `limit` (H, W) m."""
    rays, scale = camera_rays(camera)
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
