"""Lens distortion after Brown and Conrady, in OpenCV's convention: coefficients k1 k2 p1 p2 k3.

`cl/kernels/common/camera.h` is the OpenCL counterpart.
"""

from __future__ import annotations

import numpy as np

#: Steps in which the distortion is undone, and what may be left of it, of the focal length.
_STEPS, _LEFT = 12, 1e-6


def distorted(
    coefficients: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the distorted normalised coordinates (...) of undistorted ones (...).

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), and y' likewise.
    """
    k1, k2, p1, p2, k3 = coefficients
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    return xd, y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y


def distortion_jacobian(coefficients: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the derivatives (2, 2, ...) of the distorted coordinates by the undistorted ones."""
    k1, k2, p1, p2, k3 = coefficients
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = k1 + r2 * (2 * k2 + 3 * r2 * k3)
    mixed = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    return np.array(
        [
            [radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x, mixed],
            [mixed, radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x],
        ]
    )


def undistorted(
    coefficients: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the undistorted normalised coordinates (...) of distorted ones (...), by Newton's
    method; NaN where it does not converge, or beyond `largest_radius2`, where no lens shows them.
    """
    found_x, found_y = np.array(x, np.float64), np.array(y, np.float64)
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            xd, yd = distorted(coefficients, found_x, found_y)
            (a, b), (c, d) = distortion_jacobian(coefficients, found_x, found_y)
            off_x, off_y, det = xd - x, yd - y, a * d - b * c
            found_x = found_x - (d * off_x - b * off_y) / det
            found_y = found_y - (a * off_y - c * off_x) / det
        xd, yd = distorted(coefficients, found_x, found_y)
        good = np.hypot(xd - x, yd - y) < _LEFT
        good &= found_x * found_x + found_y * found_y < largest_radius2(coefficients)
    return np.where(good, found_x, np.nan), np.where(good, found_y, np.nan)


def largest_radius2(coefficients: np.ndarray) -> float:
    """Return the largest squared normalised radius at which the distortion is still one to one.

    Beyond it the polynomial turns back and would project points far outside the view into the
    picture. Infinite where it never turns back up to a radius of 10, which is 84 degrees.
    """
    k1, k2, _, _, k3 = coefficients
    r = np.linspace(0.0, 10.0, 100_001)
    slope = 1 + 3 * k1 * r**2 + 5 * k2 * r**4 + 7 * k3 * r**6
    turning = np.flatnonzero(slope <= 0)
    return float(r[turning[0]] ** 2) if turning.size else float("inf")
