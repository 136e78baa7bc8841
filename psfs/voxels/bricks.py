"""Data shared by all bricks of voxels: extremes of the evidence in tiles, and bounds of a projected
box under lens distortion. Counterpart of cl/kernels/reconstruction/bricks.h."""

from __future__ import annotations

import numpy as np

from cl import Array, Device, Launch
from cl.program import Define
from cl.signature import Argument
from cl.workgroups import row_group, size_defines
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.distortion import distort, distortion_jacobian
from psfs.silhouettes.hidden import HIDDEN, UNKNOWN
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.grid import VoxelGrid, check_size

#: Voxels of a brick along x, y, z, and bricks of a coarse brick along the same axes.
BRICK = (8, 8, 16)
COARSE_BRICK = (4, 4, 2)
#: The first of these, for the kernels.
BRICK_DEFINES: dict[str, Define] = dict(zip(("BX", "BY", "BZ"), BRICK, strict=True))
#: Edge of a tile, px, on two levels.
TILE, COARSE_TILE = 8, 32
#: Cameras for which a CPU's programs have room, or a multiple of this.
_CAMERAS = 16
#: Pixels that an item of a CPU blurs at once.
_BLUR_PACK = 16
#: Floats per camera in the array of `lens_reach`.
_REACH_FLOATS = 8


class Bricks:
    """Inputs that the occupancy kernels of one grid share: maps, tables, tiles and definitions.

    evidence: (V, H, W) int8 in counts of `step` nats. It is dilated by `OccupancyConfig.reach_px`,
    so that limbs thinner than that are not carved away (kernel: blur.cl; twin:
    `psfs.reference.surface.blur`). body: a tracked body by `psfs.voxels.body_prior.pack_body`, if
    there is one. A call enqueues the computation of the tiles: least and greatest evidence count of
    each.
    """

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        grid: VoxelGrid,
        evidence: Array,
        step: float,
        config: OccupancyConfig | None = None,
        *,
        body: Array | None = None,
    ) -> None:
        check_size(grid)
        config = config or OccupancyConfig()
        self.device, self.shape = device, grid.shape
        self._launches, self.evidence = list[Launch](), evidence
        if px := config.reach_px(rig.blur):
            self.evidence = device.empty(evidence.shape, np.int8, "the blurred evidence")
            pack = 1 if device.is_gpu else _BLUR_PACK
            kernel = device.kernel(
                "reconstruction/blur", "blur", BLUR=px, PACK=pack, UNKNOWN=UNKNOWN,
                **size_defines(device, rig.picture),
            )  # fmt: skip
            blur = device.launch(
                kernel, (-(-rig.width // pack), rig.height, len(rig)), row_group(device),
                picture=rig.picture, evidence=evidence, blurred=self.evidence,
            )  # fmt: skip
            self._launches.append(blur)
        self.picture, self.body = rig.picture, body
        self.closed_surface = config.closed_surface
        views, width, height = len(rig), rig.width, rig.height
        columns, rows = -(-width // COARSE_TILE), -(-height // COARSE_TILE)
        fine = -(-width // TILE) * -(-height // TILE)
        self.threshold = config.threshold
        self._cameras: dict[str, Argument] = {
            "n_cameras": views,
            "min_cameras": config.seeing_cameras(views),
        }
        sizes = size_defines(device, rig.picture, grid.shape)
        tiles: dict[str, Define] = {"FINE": TILE, "COARSE": COARSE_TILE}
        tiles |= {"UNKNOWN": UNKNOWN, "HIDDEN": HIDDEN}
        self.defines: dict[str, Define] = {
            **sizes,
            **_camera_defines(device, views),
            "FACES": int(config.smoothing == "faces"),
            "BODY": int(body is not None),
            "FIND_LANES": 32 if device.is_gpu else 1,
            **rig.defines,
            "REACH_FLOATS": _REACH_FLOATS,
            **tiles,
            **BRICK_DEFINES,
            **dict(zip(("CX", "CY", "CZ"), COARSE_BRICK, strict=True)),
        }
        if not rig.distorted:
            self.defines["NO_DISTORTION"] = 1
        self.n_active = device.zeros(1, np.int32, "the number of bricks")
        self.tiles = device.empty((views, fine + columns * rows, 2), np.int8, "the tiles")
        self.geometry = device.empty(4, np.float32, "the grid's position")
        table = config.probabilities(views, step).astype(np.float32)
        self.table = device.to_device(table, "the occupancy table")
        self.cameras = device.to_device(rig.packed(), "the cameras")
        reach = np.stack([lens_reach(camera) for camera in rig]).astype(np.float32)
        self.reach = device.to_device(reach, "the lenses")
        self.move_to(grid)
        lanes = 16 if device.is_gpu else 1
        tiles |= {**sizes, "LANES": lanes}
        tile = device.launch(
            device.kernel("reconstruction/tiles", "evidence_tiles", **tiles),
            (columns * rows * lanes, views),
            (lanes, 1),
            picture=self.picture,
            evidence=self.evidence,
            tiles=self.tiles,
            n_active=self.n_active,
        )
        self._launches.append(tile)

    @property
    def inputs(self) -> dict[str, Argument]:
        """The sizes and arrays that all occupancy kernels read besides the evidence, by the names
        of the kernels' arguments."""
        return {
            "picture": self.picture,
            "grid": self.shape,
            **self._cameras,
            "cameras": self.cameras,
            "reach": self.reach,
            "tiles": self.tiles,
            "table": self.table,
            "geometry": self.geometry,
            "body": self.body,
        }

    def move_to(self, grid: VoxelGrid) -> None:
        """Move to a grid of the same shape."""
        self.geometry.set(np.array([*grid.origin, grid.voxel_size], np.float32))

    def __call__(self) -> None:
        for launch in self._launches:
            launch()


def _camera_defines(device: Device, n: int) -> dict[str, Define]:
    """Return the definitions of occupancy.cl for `n` cameras: a GPU's programs know their number, a
    CPU's have room for as many."""
    if device.is_gpu:
        return {"N_CAMERAS": n, "CAMERA_ROOM": n}
    return {"CAMERA_ROOM": -(-n // _CAMERAS) * _CAMERAS}


def lane_defines(device: Device) -> dict[str, Define]:
    """Return the definitions of a brick kernel's work-group: one work-item on CPUs; on GPUs enough
    along z for a whole row of the brick and the voxels around it, times several rows."""
    if not device.is_gpu:
        return {"LANES": 1, "LANES_Z": 1}
    depth = BRICK[2] + 2
    return {"LANES": 10 * depth, "LANES_Z": depth}


def count_bricks(shape: tuple[int, int, int]) -> tuple[int, int, int]:
    """Return the number of bricks along x, y, z that cover `shape` voxels."""
    nx, ny, nz = (-(-n // b) for n, b in zip(shape, BRICK, strict=True))
    return nx, ny, nz


def lens_reach(camera: Camera) -> np.ndarray:
    """Return the bounds (8,) of a projected box, see `bricks.h`.

    They are: largest absolute derivatives of the pixel by the normalised coordinates, px (4);
    largest normalised radius within the picture; radius up to which the derivatives hold; largest
    radius that has an image; zero.
    """
    largest = min(float(np.sqrt(camera.max_radius2)), 1e15)
    u, v = _polar(min(largest, 20.0))
    x, y = distort(camera.lens, u, v)
    px = camera.K[0, 0] * x + camera.K[0, 1] * y + camera.K[0, 2]
    py = camera.K[1, 1] * y + camera.K[1, 2]
    width, height = camera.size
    inside = (px > -2) & (px < width + 1) & (py > -2) & (py < height + 1)
    step = np.hypot(u, v)[0]
    # Take the ring beyond the last visible one, since the rings are samples.
    rings = np.flatnonzero(inside.any(0))
    picture = step[min(rings.max() + 1, len(step) - 1)] if rings.size else step[1]
    if rings.size and rings.max() == len(step) - 1:
        picture = largest
    outer = 1.3 * picture
    slopes = np.abs(distortion_jacobian(camera.lens, *_polar(min(outer, 1e3)))).max((2, 3)) * 1.02
    fx, fy, skew = camera.K[0, 0], camera.K[1, 1], abs(camera.K[0, 1])
    by_x = fx * slopes[0] + skew * slopes[1]
    reach = np.zeros(_REACH_FLOATS)
    reach[:7] = *by_x, *(fy * slopes[1]), picture, outer, largest
    return reach


def _polar(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return normalised coordinates (72, 400) of rays up to `radius`, evenly spaced in both
    angles."""
    turn = np.linspace(0, 2 * np.pi, 72, endpoint=False)[:, None]
    r = np.tan(np.linspace(0, np.arctan(radius), 400))
    return r * np.cos(turn), r * np.sin(turn)
