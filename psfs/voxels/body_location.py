"""The location prior of the silhouettes by a tracked body, on the device."""

from __future__ import annotations

import numpy as np

from cl import Array, Device
from cl.workgroups import row_group, size_defines
from psfs.cameras.camera import CameraRig
from psfs.cameras.cells import CELL, cell_rays, cells
from psfs.silhouettes.appearance import ForegroundPrior


class BodyLocation:
    """Computation of a frame's location prior, in place of the one by the voxels of the frame
    before, and of the part of the body that each cell shows.

    prior: what a call computes of it is `location` and `parts`. body: the body as `pack_body` packs
    it; where it has no known cones, the location stays as it is. Kernel: body_location.cl; twin:
    `psfs.reference.body_prior.body_location`.
    """

    def __init__(self, device: Device, rig: CameraRig, prior: ForegroundPrior, body: Array) -> None:
        rows, columns = cells(rig)
        centres = np.pad(rig.centres, ((0, 0), (0, 1))).astype(np.float32)
        defines = {"CELL": CELL, **size_defines(device, rig.picture)}
        kernel = device.kernel("reconstruction/body_location", "body_location", **defines)
        self._launch = device.launch(
            kernel,
            (columns, rows, len(rig)),
            row_group(device),
            picture=rig.picture,
            centres=device.to_device(centres, "the cameras' centres"),
            rays=device.to_device(cell_rays(rig).astype(np.float32), "the cells' rays"),
            body=body,
            parts=prior.parts,
            location=prior.location,
        )

    def __call__(self) -> None:
        """Enqueue the prior of the body on the device."""
        self._launch()
