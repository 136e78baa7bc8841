"""Colours of the surface on every OpenCL device against the NumPy twin, and their meaning."""

from dataclasses import replace

import numpy as np
import pytest
from helpers import scenes
from helpers.parity import traced

from cl import Device, InputError
from psfs.cameras.rig_geometry import voxel_footprints
from psfs.reconstructor import Reconstructor
from psfs.reference.reconstructor import NumpyReconstructor, frame_evidence
from psfs.reference.surface import nearest_depth, surface_colour
from psfs.sequence import Frame
from psfs.voxels.grid import VoxelGrid


def both(device: Device, rig, grid, frame, background=None) -> tuple[np.ndarray, np.ndarray]:
    reconstructor = Reconstructor(device, rig, grid, background)
    voxels = reconstructor(frame)
    count = int(voxels.count.get()[0])
    evidence = frame_evidence(frame, rig, background, reconstructor.config.silhouette)
    expected = surface_colour(rig, grid, voxels.surface.get(count), frame.images, evidence)
    return voxels.colours().get(count), expected


def painted(rig) -> Frame:
    """Masks of the test body, and pictures that vary slowly."""
    y, x = np.mgrid[: rig.height, : rig.width]
    images = np.stack([np.stack([x, y, x + y], -1) + 20 * k for k in range(len(rig))])
    return scenes.frame(images=(images % 256).astype(np.uint8), masks=scenes.masks_of(rig))


@pytest.mark.parity("reconstruction/colour.surface_colour")
@pytest.mark.parametrize("views", [1, 2, 5])
def test_agrees_with_the_twin(device: Device, views: int) -> None:
    rig = scenes.ring(views)
    colours, expected = both(device, rig, scenes.small_grid(0.04), painted(rig))
    assert len(colours) > 100
    # Voxels at the limit of visibility, or between two pixels, may differ.
    assert (colours != expected).any(1).mean() < 0.03


@pytest.mark.parity("reconstruction/colour.nearest_depth")
@pytest.mark.parametrize("views", [1, 3])
def test_depths_agree_with_the_twin(device: Device, views: int) -> None:
    rig = scenes.ring(views)
    grid = VoxelGrid.covering(np.full(3, -4.0), np.full(3, 4.0), 0.25)
    masks = np.full((views, rig.height, rig.width), 255, np.uint8)
    voxels = Reconstructor(device, rig, grid, None)(replace(painted(rig), masks=masks))
    with traced("reconstruction/colour.nearest_depth") as launches:
        voxels.colours()
    centres = grid.centres(voxels.surface.get(int(voxels.count.get()[0])))
    depths = launches[0].after["depths"].view(np.float32)
    for view, (camera, footprint) in enumerate(
        zip(rig, voxel_footprints(rig, grid.voxel_size), strict=True)
    ):
        expected = nearest_depth(camera, centres, footprint, (rig.height, rig.width))
        assert np.isfinite(expected).any()
        # The edge of a voxel's box in the middle between two pixels.
        assert np.isclose(depths[view], expected, rtol=1e-5).mean() > 0.99


def test_a_voxel_behind_another_takes_no_colour_from_that_side(device: Device) -> None:
    """Cameras see red, but for one, which sees blue: only what it sees may be blue."""
    rig = scenes.without_distortion(scenes.ring(6))
    images = np.zeros((6, rig.height, rig.width, 3), np.uint8)
    images[..., 2] = 255
    images[0] = [255, 0, 0]
    frame = scenes.frame(images=images, masks=scenes.masks_of(rig))
    grid = scenes.small_grid(0.03)
    cloud = Reconstructor(device, rig, grid, None)(frame).cloud(colour=True)
    buffer = nearest_depth(rig[0], cloud.centres, np.zeros(2), (rig.height, rig.width))
    pixels, depth = rig[0].project(cloud.centres)
    column, row = np.rint(pixels).astype(int).T
    hidden = depth > buffer[row, column] + 6 * grid.voxel_size
    assert hidden.any()
    assert (cloud.colour[hidden, 2] == 0).mean() > 0.99
    assert (cloud.colour[~hidden, 2] > 0).any()


@pytest.mark.parametrize("twin", [True, False])
def test_masks_alone_have_no_colours(device: Device, twin: bool) -> None:
    rig = scenes.ring(2)
    kind = NumpyReconstructor if twin else Reconstructor
    frame = scenes.frame(masks=scenes.masks_of(rig))
    voxels = kind(device, rig, scenes.small_grid(), None)(frame)
    with pytest.raises(InputError, match="no pictures"):
        voxels.cloud(colour=True)
