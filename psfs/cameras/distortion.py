"""Lens distortion after Brown-Conrady, after Tsai, or of OpenCV's fisheye lens.

Coefficients k1 k2 p1 p2 k3 as in OpenCV. A sixth one, kappa, if not 0, selects Tsai's model (1987;
Rymut 2016 eq. 2.24), which is defined in the opposite direction: undistorted = distorted (1 + kappa
r^2), r the radius of the distorted coordinates. A seventh, if not 0, selects the fisheye lens, of
which the first four are k1 k2 k3 k4: a point at the angle a from the axis appears at the radius
a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8) (Kannala & Brandt, PAMI 28, 2006).
`cl/kernels/common/camera.h` is the OpenCL counterpart.
"""

from __future__ import annotations

import numpy as np

#: Newton steps to undistort at most, the largest step after which none follows, and the largest
#: residual accepted, in focal lengths. The error is about the square of the last step.
_STEPS, _LAST_STEP, _MAX_RESIDUAL = 12, 1e-9, 1e-6

#: Normalised radius up to which a polynomial is searched (84 degrees), and the share of a root's
#: size up to which its imaginary part is rounding.
_LARGEST_RADIUS, _IMAGINARY = 10.0, 1e-9

#: -kappa r^2 beyond which Tsai's cubic has no root on the side of the lens.
_TSAI_END = 4 / 27


def _tsai_radius_ratio(stretch: np.ndarray) -> np.ndarray:
    """Return the ratio s (...) of distorted to undistorted radius r, for `stretch` = kappa r^2
    (...).

    s is the root of stretch s^3 + s - 1 = 0 that is 1 at stretch 0; NaN below stretch -4/27.
    """
    root = np.sqrt(3 * np.abs(stretch))
    with np.errstate(invalid="ignore", divide="ignore"):
        wide = np.sinh(np.arcsinh(1.5 * root) / 3)
        narrow = np.sin(np.arcsin(1.5 * root) / 3)
        share = 2 * np.where(stretch > 0, wide, narrow) / root
    # One Newton step for the last digits; for a tiny stretch the series, where the formula is 0 /
    # 0.
    share = np.where(np.abs(stretch) < 1e-12, 1 - stretch, share)
    slope = 3 * stretch * share**2 + 1
    return share - (stretch * share**3 + share - 1) / np.where(slope > 1e-6, slope, 1)


def _is_fisheye(coefficients: np.ndarray) -> bool:
    return len(coefficients) > 6 and bool(coefficients[6])


def _is_radial(coefficients: np.ndarray) -> bool:
    """Return whether the lens is Tsai's or a fisheye lens, without a tangential part."""
    return bool(np.any(coefficients[5:]))


def _brown_share(coefficients: np.ndarray, r2: np.ndarray) -> np.ndarray:
    k1, k2, _, _, k3 = coefficients[:5]
    return np.asarray(1 + r2 * (k1 + r2 * (k2 + r2 * k3)))


def _radial_shares(coefficients: np.ndarray, r2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the ratio (...) of distorted to undistorted radius without the tangential part, and
    twice its derivative by the squared undistorted radius r2 (...)."""
    if not _is_radial(coefficients):
        k1, k2, _, _, k3 = coefficients[:5]
        return _brown_share(coefficients, r2), 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3))
    if not _is_fisheye(coefficients):
        kappa = coefficients[5]
        share = _tsai_radius_ratio(kappa * r2)
        return share, -2 * kappa * share**3 / (1 + 3 * kappa * r2 * share**2)
    r = np.sqrt(r2)
    angle = np.arctan(r)
    powers = [1.0, *coefficients[:4]]
    image = angle * np.polyval(powers[::-1], angle**2)
    rates = [(2 * k + 1) * value for k, value in enumerate(powers)]
    rate = np.polyval(rates[::-1], angle**2) / (1 + r2)
    near = r2 < 1e-8
    share = np.where(near, 1.0, image / np.where(near, 1.0, r))
    slope = (rate - share) / np.where(near, 1.0, r2)
    return share, np.where(near, 2 * (coefficients[0] - 1 / 3), slope)


def distort(
    coefficients: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distort normalised coordinates (...).

    x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), and y' likewise; or
    as the other lenses do.
    """
    r2 = x * x + y * y
    if _is_radial(coefficients):
        share, _ = _radial_shares(coefficients, r2)
        return x * share, y * share
    share = _brown_share(coefficients, r2)
    p1, p2 = coefficients[2:4]
    xd = x * share + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    return xd, y * share + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y


def distortion_jacobian(coefficients: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the derivatives (2, 2, ...) of the distorted with respect to the undistorted
    coordinates."""
    share, slope = _radial_shares(coefficients, x * x + y * y)
    p1, p2 = (0.0, 0.0) if _is_radial(coefficients) else coefficients[2:4]
    mixed = x * y * slope + 2 * p1 * x + 2 * p2 * y
    by_x = share + x * x * slope + 2 * p1 * y + 6 * p2 * x
    by_y = share + y * y * slope + 6 * p1 * y + 2 * p2 * x
    return np.array([[by_x, mixed], [mixed, by_y]])


def undistort(
    coefficients: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Undistort normalised coordinates (...) by Newton's method.

    NaN where it does not converge, or beyond `largest_radius2`, where no lens forms an image.
    """
    if len(coefficients) > 5 and coefficients[5]:
        stretch = coefficients[5] * (x * x + y * y)
        good = 1 + 3 * stretch > 0  # farther out the undistorted radius would shrink again
        return np.where(good, x * (1 + stretch), np.nan), np.where(good, y * (1 + stretch), np.nan)
    found_x, found_y = np.array(x, np.float64), np.array(y, np.float64)
    with np.errstate(all="ignore"):
        for _ in range(_STEPS):
            xd, yd = distort(coefficients, found_x, found_y)
            (a, b), (c, d) = distortion_jacobian(coefficients, found_x, found_y)
            off_x, off_y, det = xd - x, yd - y, a * d - b * c
            step_x, step_y = (d * off_x - b * off_y) / det, (a * off_y - c * off_x) / det
            found_x, found_y = found_x - step_x, found_y - step_y
            if not (np.abs(step_x) + np.abs(step_y) > _LAST_STEP).any():
                break
        xd, yd = distort(coefficients, found_x, found_y)
        good = np.hypot(xd - x, yd - y) < _MAX_RESIDUAL
        good &= found_x * found_x + found_y * found_y < largest_radius2(coefficients)
    return np.where(good, found_x, np.nan), np.where(good, found_y, np.nan)


def largest_radius2(coefficients: np.ndarray) -> float:
    """Return the largest squared normalised radius up to which the distortion is one to one.

    Beyond it the polynomial decreases and would project points far outside the view into the
    picture. Infinite if it increases up to a radius of 10, which is 84 degrees.
    """
    k1, k2, _, _, k3, *kappa = coefficients
    if _is_fisheye(coefficients):
        rates = [(2 * k + 1) * value for k, value in enumerate([1.0, *coefficients[:4]])]
        roots = np.roots(rates[::-1])
        turning = np.sqrt(roots.real[(np.abs(roots.imag) <= _IMAGINARY) & (roots.real > 0)])
        end = float(turning.min(initial=np.pi))
        return float(np.tan(end)) ** 2 if end < np.arctan(_LARGEST_RADIUS) else float("inf")
    if any(kappa):
        return float(_TSAI_END / -kappa[0]) if kappa[0] < 0 else float("inf")
    # Of 1 / r^2, where the slope of the distorted radius is 0; so no coefficient divides.
    roots = np.roots([1.0, 3 * k1, 5 * k2, 7 * k3])
    turning = roots.real[np.abs(roots.imag) <= _IMAGINARY * np.abs(roots)]
    greatest = float(turning.max(initial=0.0))
    return 1 / greatest if greatest >= 1 / _LARGEST_RADIUS**2 else float("inf")
