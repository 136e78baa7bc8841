"""Triangles and lines for a viewer, made from clouds, meshes and cameras."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
import trimesh
from scipy import spatial

from psfs.cameras.camera import CameraRig
from psfs.common.open3d import load_open3d
from psfs.mesh.marching_cubes import CLAY
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.grid import VoxelCloud, VoxelGrid
from psfs.voxels.normals import estimate_normals

#: What a voxel's colour can show.
COLOURINGS = ("colour", "probability", "height")
#: Number of frames whose triangles are cached, so that stepping to and fro is fast.
_CACHED_FRAMES = 16
_CAMERA, _FLOOR = (40, 60, 95), (150, 150, 146)
_AXES = ((200, 60, 50), (60, 160, 60), (60, 90, 210))


@dataclass(frozen=True, eq=False)
class SurfaceDrawing:
    """A coloured triangle mesh.

    vertices: (N, 3) m. faces: (M, 3) int. normals: (N, 3) unit. colours: (N, 3) uint8 RGB. opacity:
    0 (invisible) to 1 (opaque).
    """

    vertices: np.ndarray
    faces: np.ndarray
    normals: np.ndarray
    colours: np.ndarray
    opacity: float = 1.0


@dataclass(frozen=True, eq=False)
class Lines:
    """Coloured line segments.

    points: (N, 3) m. pairs: (E, 2) int. colours: (E, 3) uint8 RGB. width: px.
    """

    points: np.ndarray
    pairs: np.ndarray
    colours: np.ndarray
    width: float = 3.0


Drawing = SurfaceDrawing | Lines
#: The cloud of a frame (its index), and its mesh where meshes are wanted.
Shape = Callable[[int], tuple[VoxelCloud, trimesh.Trimesh | None]]


@dataclass(frozen=True)
class Layer:
    """Something that a viewer shows or hides.

    drawing: function of a frame (its index) and a colouring (one of COLOURINGS); None for nothing.
    Nothing is redrawn as long as it returns the same object.
    """

    name: str
    drawing: Callable[[int, str], Drawing | None]
    shown: bool = True


def make_cubes(cloud: VoxelCloud) -> tuple[np.ndarray, np.ndarray]:
    """Return the voxels as cubes: vertices (8 N, 3) m, triangles (12 N, 3) int32."""
    corners = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), -1).reshape(8, 3)
    vertices = cloud.centres[:, None] + (corners - 0.5) * cloud.grid.voxel_size
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = np.array([[q[i] for i in half] for q in quads for half in ((0, 1, 2), (0, 2, 3))])
    faces = 8 * np.arange(len(cloud))[:, None, None] + triangles
    return vertices.reshape(-1, 3), faces.reshape(-1, 3).astype(np.int32)


def voxel_colours(
    cloud: VoxelCloud, colouring: str, low: float = 0.0, high: float = 1.0
) -> np.ndarray:
    """Return (N, 3) uint8 RGB of the voxels.

    colouring: one of COLOURINGS. "colour": the pictures' colours, or clay if the cloud has none;
    "probability": viridis from the threshold to 1; "height": turbo from `low` to `high`, m.
    """
    if colouring == "probability":
        least = OccupancyConfig().threshold
        return _apply_colour_map((cloud.probability - least) / (1 - least), cv2.COLORMAP_VIRIDIS)
    if colouring == "height":
        return _apply_colour_map((cloud.centres[:, 2] - low) / (high - low), cv2.COLORMAP_TURBO)
    if cloud.colour is None:
        return np.tile(np.rint(255 * np.array(CLAY)).astype(np.uint8), (len(cloud), 1))
    return cloud.colour


def _apply_colour_map(values: np.ndarray, colours: int) -> np.ndarray:
    """Map values 0..1 to (N, 3) uint8 RGB by one of OpenCV's colour maps."""
    levels = np.rint(255 * np.clip(values, 0, 1)).astype(np.uint8)
    if not len(levels):
        return np.zeros((0, 3), np.uint8)
    return cv2.applyColorMap(levels[:, None], colours)[:, 0, ::-1]


def colour_scale(colouring: str, low: float, high: float) -> tuple[str, np.ndarray]:
    """Return a label and a colour strip (12, 256, 3) uint8 RGB from left to right.

    The strip is empty where the colours are the pictures' own.
    """
    steps = np.linspace(0, 1, 256)
    if colouring == "probability":
        strip = _apply_colour_map(steps, cv2.COLORMAP_VIRIDIS)
        text = f"{OccupancyConfig().threshold:g} to 1"
    elif colouring == "height":
        strip, text = _apply_colour_map(steps, cv2.COLORMAP_TURBO), f"{low:.3g} to {high:.3g} m"
    else:
        return "the pictures' colours", np.zeros((0, 256, 3), np.uint8)
    return text, np.ascontiguousarray(np.broadcast_to(strip, (12, 256, 3)))


def make_voxel_layer(
    shape: Shape,
    grid: VoxelGrid,
    name: str = "voxels",
    opacity: float = 1.0,
) -> Layer:
    """Make the layer of a run's clouds as cubes, or of their meshes.

    A mesh's vertices take the colour of the nearest voxel. grid: of the run.
    """
    low, high = float(grid.low[2]), float(grid.high[2])
    bare = np.zeros((0, 3), np.uint8)

    @lru_cache(_CACHED_FRAMES)
    def triangles(frame: int) -> tuple[VoxelCloud, SurfaceDrawing, np.ndarray]:
        """Return the cloud, the surface without colours, and the voxel (N,) of each vertex."""
        cloud, mesh = shape(frame)
        if mesh is None:
            vertices, faces = make_cubes(cloud)
            normals = np.repeat(estimate_normals(cloud), 8, axis=0)
            voxel = np.repeat(np.arange(len(cloud)), 8)
        else:
            vertices, faces = np.array(mesh.vertices), np.array(mesh.faces, np.int32)
            normals = np.array(mesh.vertex_normals)
            _, voxel = spatial.cKDTree(cloud.centres).query(vertices)
        return cloud, SurfaceDrawing(vertices, faces, normals, bare, opacity), voxel

    @lru_cache(_CACHED_FRAMES)
    def drawing(frame: int, colouring: str) -> SurfaceDrawing | None:
        cloud, surface, voxel = triangles(frame)
        if not len(cloud):
            return None
        return replace(surface, colours=voxel_colours(cloud, colouring, low, high)[voxel])

    return Layer(name, drawing)


def make_static_layer(name: str, drawing: Drawing) -> Layer:
    """Make a layer of a drawing that is the same in all frames."""
    return Layer(name, lambda _frame, _colouring: drawing)


def draw_frusta(rig: CameraRig) -> Lines:
    """Draw the views' frusta without lens distortion.

    Their depth is a tenth of the cameras' mean distance from their centroid.
    """
    depth = 0.1 * float(np.linalg.norm(rig.centres - rig.centres.mean(0), axis=1).mean() or 1.0)
    lines_of = load_open3d().geometry.LineSet.create_camera_visualization
    every = load_open3d().geometry.LineSet()
    for camera in rig:
        extrinsic = np.eye(4)
        extrinsic[:3, :3], extrinsic[:3, 3] = camera.R, camera.t
        every += lines_of(*camera.size, camera.K, extrinsic, depth)
    pairs = np.array(every.lines)
    return Lines(
        np.array(every.points), pairs, np.tile(np.array(_CAMERA, np.uint8), (len(pairs), 1))
    )


def draw_floor(grid: VoxelGrid) -> Lines:
    """Draw a chequered floor z = 0 under `grid`, in squares of 1, 0.1, ... m, and the world's axes.

    The axes are x red, y green, z blue, one square long.
    """
    across = float(np.max((grid.high - grid.low)[:2]))
    square = 10.0 ** np.floor(np.log10(across))
    low, high = np.floor(grid.low[:2] / square) - 1, np.ceil(grid.high[:2] / square) + 1
    ends = []
    for axis in (0, 1):
        for at in np.arange(low[axis], high[axis] + 1):
            for end in (low, high):
                point = np.array([*end, 0.0])
                point[axis] = at
                ends.append(point * square)
    n_lines = len(ends) // 2
    points = np.array([*ends, np.zeros(3), *(square * np.eye(3))])
    pairs = [(2 * k, 2 * k + 1) for k in range(n_lines)]
    pairs += [(len(ends), len(ends) + 1 + axis) for axis in range(3)]
    return Lines(points, np.array(pairs), np.array([*([_FLOOR] * n_lines), *_AXES], np.uint8))
