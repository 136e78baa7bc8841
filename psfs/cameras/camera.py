"""Calibrated cameras and their projection (Brown-Conrady and fisheye as in OpenCV, or Tsai).

World: right-handed, metres, Z up. `x_cam = R x_world + t`; the camera looks along +z, x right, y
down; pixel centres at integer coordinates. OpenCL's counterpart: `cl/kernels/common/camera.h`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cl import InputError
from psfs.cameras.distortion import distort, largest_radius2, undistort
from psfs.common.ranges import LARGEST, check_name, check_picture_size

#: Largest rig.
MOST_CAMERAS = 1000
#: Floats per camera in `CameraRig.packed()`.
CAMERA_FLOATS = 32
#: Points projected, or pixels traced, at a time: their values stay in the cache, which is ten times
#: as fast as all at once.
BLOCK = 16_384
#: Shortest focal length, px; a smaller number must be in another unit.
_MIN_FOCAL_LENGTH_PX = 0.1
#: How many coefficients leave no doubt which they are: OpenCV's numbers, or the radial ones alone.
_COEFFICIENTS = (1, 2, 4, 5, 8, 12, 14)


@dataclass(frozen=True, eq=False)
class Camera:
    """One calibrated camera.

    K: (3, 3) intrinsic matrix, px. distortion: (5,) = k1 k2 p1 p2 k3. R: (3, 3) and t: (3,) m take
    world to camera. size: (width, height) px. kappa: Tsai's radial distortion of normalised
    coordinates, used instead of `distortion` (see `distortion.py`). fisheye: whether
    `distortion` begins with k1 k2 k3 k4 of OpenCV's fisheye lens. hidden: (height, width) bool,
    the pixels where furniture hides what is behind it, or None. blur: standard deviation, px, of
    the calibration's error; 0 if it is sound, see `psfs.diagnostics.alignment`. Raises InputError
    if R is not a rotation, a number is not finite, a shape is wrong, or both distortions are given.
    """

    name: str
    K: np.ndarray
    distortion: np.ndarray
    R: np.ndarray
    t: np.ndarray
    size: tuple[int, int]
    kappa: float = 0.0
    hidden: np.ndarray | None = None
    fisheye: bool = False
    blur: float = 0.0

    def __post_init__(self) -> None:
        check_name(self.name, "a camera")
        distortion = np.zeros(5)
        stated = np.asarray(self.distortion, np.float64).ravel()
        most, names = (
            (4, "k1 k2 k3 k4 of a fisheye lens") if self.fisheye else (5, "k1 k2 p1 p2 k3")
        )
        if stated.any() and stated.size not in _COEFFICIENTS:
            raise InputError(
                f"camera {self.name}: {stated.size} distortion coefficients; "
                f"expected {most} ({names}), with 0 for those that the lens lacks"
            )
        if np.any(stated[most:]):
            raise InputError(
                f"camera {self.name}: {stated.size} distortion coefficients; "
                f"expected at most {most} ({names})"
            )
        distortion[: min(5, stated.size)] = stated[:5]
        values = {"K": (self.K, (3, 3)), "R": (self.R, (3, 3)), "t": (self.t, (3,))}
        for field, (value, shape) in values.items():
            array = np.asarray(value, np.float64)
            if array.size != np.prod(shape):
                raise InputError(
                    f"camera {self.name}: {field} has {array.size} values; expected {shape}"
                )
            object.__setattr__(self, field, array.reshape(shape))
        object.__setattr__(self, "distortion", distortion)
        object.__setattr__(self, "size", (int(self.size[0]), int(self.size[1])))
        self._check()

    def _check(self) -> None:
        if self.kappa and (self.distortion.any() or self.fisheye):
            raise InputError(f"camera {self.name}: distortion beside Tsai's kappa; expected one")
        for field in ("K", "distortion", "kappa", "R", "t"):
            values = np.asarray(getattr(self, field))
            if not np.isfinite(values).all():
                raise InputError(f"camera {self.name}: {field} holds a number that is not finite")
            if np.abs(values).max() > LARGEST:
                largest = values.ravel()[np.abs(values).argmax()]
                raise InputError(
                    f"camera {self.name}: {field} holds {largest:g}; expected up to {LARGEST:g}"
                )
        if np.abs(self.R @ self.R.T - np.eye(3)).max() > 1e-3 or np.linalg.det(self.R) < 0:
            raise InputError(
                f"camera {self.name}: R is not a rotation (R R^T differs from the identity by "
                f"{np.abs(self.R @ self.R.T - np.eye(3)).max():.3g}, "
                f"determinant {np.linalg.det(self.R):.3g}; expected 0 and 1)"
            )
        if min(self.K[0, 0], self.K[1, 1]) < _MIN_FOCAL_LENGTH_PX:
            raise InputError(
                f"camera {self.name}: focal lengths {self.K[0, 0]:g}, {self.K[1, 1]:g}; "
                f"expected numbers of pixels from {_MIN_FOCAL_LENGTH_PX:g} on"
            )
        if np.abs(self.K[[1, 2, 2, 2], [0, 0, 1, 2]] - [0, 0, 0, 1]).max() > 1e-9:
            raise InputError(
                f"camera {self.name}: the intrinsic matrix is {self.K.tolist()}; expected "
                "[[fx, skew, cx], [0, fy, cy], [0, 0, 1]]"
            )
        check_picture_size(self.size, f"camera {self.name}: size")
        if self.hidden is not None and self.hidden.shape != self.size[::-1]:
            raise InputError(
                f"camera {self.name}: hidden is {self.hidden.shape}; expected {self.size[::-1]}"
            )

    @property
    def centre(self) -> np.ndarray:
        """Position of the camera in the world (3,), m."""
        return -self.R.T @ self.t

    @property
    def lens(self) -> np.ndarray:
        """Lens distortion (7,): k1 k2 p1 p2 k3, kappa, and whether it is a fisheye lens."""
        return np.append(self.distortion, [self.kappa, self.fisheye])

    @cached_property
    def max_radius2(self) -> float:
        """Largest squared normalised radius that is imaged, see `largest_radius2`.

        Points beyond it count as unseen.
        """
        return largest_radius2(self.lens)

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Project world points (..., 3) to pixels (..., 2) and depths (...) m.

        A point that has no image (behind the camera, or beyond `max_radius2`) gets a depth of at
        most zero and the pixel (-1e6, -1e6). Whether a pixel lies inside the picture is left to the
        caller, or to `look_up`.
        """
        u, v, depth, seen = self._project_points(np.asarray(points, np.float64))
        pixels = np.full((*depth.shape, 2), -1e6)
        np.copyto(pixels[..., 0], u, where=seen)
        np.copyto(pixels[..., 1], v, where=seen)
        return pixels, np.where(seen, depth, np.minimum(depth, 0.0))

    def _project_points(
        self, points: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return columns, rows, depths (...) of points (..., 3), and whether each has an image."""
        flat = points.reshape(-1, 3)
        u, v, depth = np.empty((3, len(flat)))
        seen = np.empty(len(flat), bool)
        for start in range(0, len(flat), BLOCK):
            block = slice(start, start + BLOCK)
            u[block], v[block], depth[block], seen[block] = self._project_block(flat[block])
        shape = points.shape[:-1]
        return u.reshape(shape), v.reshape(shape), depth.reshape(shape), seen.reshape(shape)

    def _project_block(
        self, points: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        x, y, depth = self.R @ points.T + self.t[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = x / depth, y / depth
            seen = (depth > 1e-6) & (x * x + y * y < self.max_radius2)
            if self.lens.any():
                x, y = distort(self.lens, x, y)
            u = self.K[0, 0] * x + self.K[0, 1] * y + self.K[0, 2]
            v = self.K[1, 1] * y + self.K[1, 2]
        return u, v, depth, seen

    def look_up(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Find the pixels that show world points (N, 3).

        Returns whether each point lies in the picture, (N,) bool; then, for the K that do, row and
        column (K,) of the nearest pixel, and depth (K,) m.
        """
        u, v, depth, seen = self._project_points(np.asarray(points, np.float64))
        with np.errstate(invalid="ignore"):
            x, y = np.floor(u + 0.5), np.floor(v + 0.5)
            inside = seen & (x >= 0) & (y >= 0) & (x < self.size[0]) & (y < self.size[1])
        return inside, y[inside].astype(int), x[inside].astype(int), depth[inside]

    def undistort(self, pixels: np.ndarray) -> np.ndarray:
        """Remove the distortion from pixels (..., 2); NaN where that is not possible."""
        K = self.K
        y = (pixels[..., 1] - K[1, 2]) / K[1, 1]
        x = (pixels[..., 0] - K[0, 2] - K[0, 1] * y) / K[0, 0]
        x, y = undistort(self.lens, x, y)
        return np.stack([K[0, 0] * x + K[0, 1] * y + K[0, 2], K[1, 1] * y + K[1, 2]], -1)

    def normalise(self, pixels: np.ndarray) -> np.ndarray:
        """Return the undistorted intersections (N, 2) of the rays through pixels (N, 2) with the
        plane at depth 1. Pixels that the lens does not show get NaN; with Brown's distortion the
        approximation of cv2.undistortPoints."""
        K, focal = self.K, self.K[[0, 1], [0, 1]]
        pinhole = np.array(pixels, np.float64).reshape(-1, 2)
        pinhole[:, 0] -= K[0, 1] * (pinhole[:, 1] - K[1, 2]) / K[1, 1]
        pinhole = (pinhole - K[:2, 2]) * (1 / focal)
        if not self.lens.any():
            return pinhole
        plane = np.stack(undistort(self.lens, *pinhole.T), -1)
        lost = np.isnan(plane[:, 0]) & (self.kappa == 0 and not self.fisheye)
        if lost.any():
            import cv2  # takes a while to load

            known = pinhole[lost, None], np.eye(3), self.distortion
            plane[lost] = cv2.undistortPoints(*known).reshape(-1, 2)
        return plane

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """Return the world directions (N, 3), of depth 1, of the rays through pixels (N, 2), see
        `normalise`."""
        return np.column_stack([self.normalise(pixels), np.ones(len(pixels))]) @ self.R

    def scaled(self, factor: float) -> Camera:
        """Return the camera for a picture that `scale_picture` resizes by `factor` (pixel centres
        stay at integers)."""
        K = self.K.copy()
        K[:2, 2] += 0.5
        K[:2] *= factor
        K[:2, 2] -= 0.5
        size = (round(self.size[0] * factor), round(self.size[1] * factor))
        hidden = self.hidden
        if hidden is not None:
            rows, columns = (
                np.minimum(((np.arange(n) + 0.5) / factor).astype(int), last - 1)
                for n, last in zip(size[::-1], hidden.shape, strict=True)
            )
            hidden = hidden[np.ix_(rows, columns)]
        return replace(self, K=K, size=size, hidden=hidden, blur=factor * self.blur)

    def refocused(self, factor: float) -> Camera:
        """Return the camera with focal lengths `factor` times as long."""
        K = self.K.copy()
        K[[0, 0, 1], [0, 1, 1]] *= factor
        return replace(self, K=K)

    def packed(self) -> np.ndarray:
        """Return (CAMERA_FLOATS,) float32 for the kernels, in the order of `camera.h`."""
        out = np.zeros(CAMERA_FLOATS, np.float32)
        out[0:9] = self.R.ravel()
        out[9:12] = self.t
        out[12:17] = self.K[0, 0], self.K[1, 1], self.K[0, 2], self.K[1, 2], self.K[0, 1]
        out[17:22] = self.distortion
        out[22] = min(self.max_radius2, 1e30)
        out[23:25] = self.size
        out[25:28] = self.centre
        out[28:30] = self.kappa, self.fisheye
        return out


@dataclass(frozen=True, eq=False)
class CameraRig:
    """The calibrated cameras of one scene.

    `width` and `height` are the largest of all cameras: the pictures of all views are stacked into
    one array (V, height, width, ...), padded with zeros.
    """

    cameras: tuple[Camera, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(self.cameras))
        if not 1 <= len(self.cameras) <= MOST_CAMERAS:
            raise InputError(f"a rig of {len(self.cameras)} cameras; expected 1 to {MOST_CAMERAS}")
        names = [camera.name for camera in self.cameras]
        if len(set(names)) < len(names):
            raise InputError(f"camera names must differ; found {', '.join(names)}")

    def __len__(self) -> int:
        return len(self.cameras)

    def __iter__(self) -> Iterator[Camera]:
        return iter(self.cameras)

    def __getitem__(self, index: int) -> Camera:
        return self.cameras[index]

    @property
    def names(self) -> list[str]:
        return [camera.name for camera in self.cameras]

    @property
    def width(self) -> int:
        return max(camera.size[0] for camera in self.cameras)

    @property
    def height(self) -> int:
        return max(camera.size[1] for camera in self.cameras)

    @property
    def distorted(self) -> bool:
        """Whether any camera has lens distortion."""
        return any(camera.lens.any() for camera in self)

    @property
    def centres(self) -> np.ndarray:
        """Camera positions (V, 3), m."""
        return np.stack([camera.centre for camera in self.cameras])

    def scaled(self, factor: float) -> CameraRig:
        return CameraRig(tuple(camera.scaled(factor) for camera in self.cameras))

    def crop(self, stack: np.ndarray | None) -> list[np.ndarray]:
        """Return the pictures (h, w, ...) in a stack (V, height, width, ...), which must not be
        None, without the padding."""
        assert stack is not None
        return [p[: c.size[1], : c.size[0]] for p, c in zip(stack, self, strict=True)]

    def factor_within(self, longest: int) -> float:
        """Return the factor, at most 1, at which no picture is longer than `longest` px."""
        return min(1.0, longest / max(self.width, self.height))

    def subset(self, names: Sequence[str]) -> CameraRig:
        by_name = {camera.name: camera for camera in self.cameras}
        missing = [name for name in names if name not in by_name]
        if missing:
            raise InputError(f"no camera {', '.join(missing)}; the rig has {', '.join(self.names)}")
        return CameraRig(tuple(by_name[name] for name in names))

    @property
    def hidden(self) -> np.ndarray | None:
        """(V, height, width) bool, see `Camera`; None where no camera has hidden pixels."""
        if all(camera.hidden is None for camera in self):
            return None
        maps = np.zeros((len(self), self.height, self.width), bool)
        for hidden, camera in zip(self.crop(maps), self, strict=True):
            if camera.hidden is not None:
                hidden[...] = camera.hidden
        return maps

    def with_hidden(self, maps: np.ndarray) -> CameraRig:
        """Return the same cameras with the hidden pixels of maps (V, height, width) bool."""
        hidden = [own.copy() if own.any() else None for own in self.crop(maps)]
        pairs = zip(self, hidden, strict=True)
        return CameraRig(tuple(replace(camera, hidden=own) for camera, own in pairs))

    @property
    def blur(self) -> float:
        """Standard deviation of the calibration's error, px: the largest of the cameras."""
        return max(camera.blur for camera in self)

    @property
    def picture(self) -> tuple[int, int]:
        """Width and height, px, of the stack of pictures, as the kernels take them (sizes.h)."""
        return self.width, self.height

    @property
    def defines(self) -> dict[str, int]:
        """The compile-time definitions that `camera.h` needs."""
        tsai, fisheye = any(c.kappa for c in self), any(c.fisheye for c in self)
        return {"CAMERA_FLOATS": CAMERA_FLOATS, "TSAI": int(tsai), "FISHEYE": int(fisheye)}

    def packed(self) -> np.ndarray:
        """Return (V, CAMERA_FLOATS) float32 for the kernels."""
        return np.stack([camera.packed() for camera in self.cameras])
