"""What a coloured cloud looks like from a camera: to judge its colours by."""

from __future__ import annotations

import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.footprints import pixel_boxes, voxel_footprints
from psfs.voxels.grid import VoxelCloud


def recoloured(cloud: VoxelCloud, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Picture (H, W, 3) uint8 BGR of a coloured cloud, and (H, W) bool where it shows a voxel.

    Every voxel covers the bounding box of its projected cube, nearer ones hide others. Raises
    ValueError if the cloud has no colours.
    """
    if cloud.colour is None:
        raise ValueError("expected a cloud with colours")
    width, height = camera.size
    footprint = voxel_footprints(CameraRig((camera,)), cloud.grid.voxel_size)[0]
    boxes = pixel_boxes(camera, cloud.centres, footprint)
    far_to_near = np.argsort(-boxes[3], kind="stable")
    shown, low, end = (values[far_to_near] for values in boxes[:3])
    picture, covered = np.zeros((height, width, 3), np.uint8), np.zeros((height, width), bool)
    for voxel, (x0, y0), (x1, y1) in zip(shown, low, end, strict=True):
        picture[y0:y1, x0:x1] = cloud.colour[voxel, ::-1]
        covered[y0:y1, x0:x1] = True
    return picture, covered


def peak_signal_to_noise(picture: np.ndarray, recoloured: np.ndarray, inside: np.ndarray) -> float:
    """PSNR, dB, of 8-bit pictures (H, W, 3) over the pixels `inside` (H, W) bool."""
    error = picture[inside].astype(np.float64) - recoloured[inside]
    return float(10 * np.log10(255**2 / np.maximum((error**2).mean(), 1e-12)))
