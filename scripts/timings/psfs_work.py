"""Bytes and operations that the stages cannot do without: what limits their time."""

from __future__ import annotations

from psfs.grid import VoxelGrid
from timings.bench_scene import Scene

#: In the order of the pipeline.
STAGES = (
    *("upload", "silhouette", "occupancy", "smoothing", "surface"),
    *("learning", "colour", "other"),
)
#: What the comparison with carving alone is about.
SHAPE_STAGES = ("silhouette", "occupancy", "smoothing", "surface")
_STAGE_OF = {
    "upload": "upload",
    "copy": "upload",
    "log_ratio": "silhouette",
    "silhouette": "silhouette",
    "mask_silhouette": "silhouette",
    "evidence_tiles": "occupancy",
    "find_bricks": "occupancy",
    "occupancy": "occupancy",
    "sparse_occupancy": "occupancy",
    "smooth": "smoothing",
    "threshold": "surface",
    "count_slabs": "surface",
    "list_surface": "surface",
    "mark": "learning",
    "observe": "learning",
    "fade": "learning",
    "colour_table": "learning",
    "nearest_depth": "colour",
    "surface_colour": "colour",
    "fill": "other",
}
#: Floating-point operations: per pixel of a silhouette; per projection of a point by a camera
#: without distortion, the look-up included; per voxel of the smoothing.
_PIXEL, _PROJECTION, _MEAN = 60, 30, 27


def stage_of(kernel: str) -> str:
    return _STAGE_OF.get(kernel, "other")


def stage_work(scene: Scene, grid: VoxelGrid, surface: int) -> dict[str, tuple[float, float]]:
    """(bytes, operations) of each stage, in dense mode and without any cleverness: every byte of
    input and output once, every voxel projected into every camera. A stage that needs less time
    than its limit does less than that.
    """
    pixels = len(scene.rig) * scene.rig.width * scene.rig.height
    voxels = grid.size
    padded = 1.0
    for n in grid.shape:
        padded *= n + 2
    return {
        "upload": (3 * pixels, 0),
        "silhouette": ((3 + 32 + 3) * pixels, _PIXEL * pixels),
        "occupancy": (pixels + 4 * padded, _PROJECTION * padded * len(scene.rig)),
        "smoothing": (4 * padded + 4 * voxels, _MEAN * voxels),
        "surface": (4 * voxels + voxels / 4 + 4 * surface, 2 * voxels),
        "colour": (8 * pixels + 16 * surface, 2 * _PROJECTION * surface * len(scene.rig)),
    }
