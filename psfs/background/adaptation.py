"""The background follows slow changes of the light where nobody stands, on the device."""

from __future__ import annotations

import numpy as np

from cl import Array, Device
from cl.workgroups import pixel_pack, row_group
from psfs.cameras.camera import CameraRig
from psfs.cameras.cells import CELL, cells
from psfs.config import SilhouetteConfig

#: Every pixel is looked at once in so many frames, a part of the picture in each.
PERIOD = 8
#: The variance drifts so many times as slowly as the mean: it needs more samples.
SLOWER = 4
#: Squared distance to the background, in its standard deviations, of what it may drift to. Shadows
#: and whatever else passes for background are further away, and leave no trace.
NEAREST = 30.0
#: Grey levels of background that must have been seen in a frame to tell the view's change.
ENOUGH = 10_000.0
_GROUP = 256


class Adaptation:
    """`adaptation()`: mean and variance of the background drift towards the frame on the device, by
    `config.adapt` of the difference per frame (Song et al. eq. (1) with a memory that fades).

    Only pixels that look much like the background do, and none where a voxel is seen within two
    cells, or foreground in the same cell: who keeps still does not become background. The others
    become brighter or darker by the share that the view as a whole did in the frame before.
    """

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        config: SilhouetteConfig,
        pictures: Array,
        evidence: Array,
        marks: Array,
        sizes: Array,
        planes: Array,
    ) -> None:
        (rows, columns), pack = cells(rig), pixel_pack(device, rig.width)
        blocks = -(-rig.width // max(CELL, pack))
        mean_rate, variance_rate = rates(config)
        reach = (marks.shape[1] - rows) // 2
        # A GPU needs more work-items to hide that they wait for memory.
        parts = CELL if device.is_gpu else 1
        defines: dict[str, int | float] = dict(
            **{"WIDTH": rig.width, "HEIGHT": rig.height, "PERIOD": PERIOD},
            **{"CELLS_X": columns, "CELLS_Y": rows, "CELL": CELL, "REACH": reach},
            **{"PARTS": parts, "PACK": pack},
            **{"MEAN_RATE": mean_rate, "VARIANCE_RATE": variance_rate, "NEAREST": NEAREST},
            **{"VIEWS": len(rig), "ENOUGH": ENOUGH},
            LEAST_VARIANCE=float(config.sigma_floor**2),
            WIDTH_GREY=float(config.shadow_width_grey),
            WIDTH_COLOUR=float(config.shadow_width_colour),
        )
        size = (blocks, parts * -(-rows // PERIOD), len(rig))
        defines |= {"LOOKED_AT": size[0] * size[1], "GROUP": _GROUP}
        drift = device.zeros(len(rig), np.float32, "the views' change of light")
        shape = (len(rig), size[0] * size[1], 2)
        changes = device.empty(shape, np.float32, "the views' change of light")
        light = {"drift": drift, "changes": changes}
        adapt = device.kernel("reconstruction/adaptation", "adapt", **defines)
        view_drift = device.kernel("reconstruction/adaptation", "view_drift", **defines)
        self._adapt = device.launch(
            adapt,
            size,
            row_group(device, blocks),
            images=pictures,
            evidence=evidence,
            marks=marks,
            sizes=sizes,
            phase=0,
            background=planes,
            **light,
        )
        groups = (_GROUP * len(rig),)
        self._view_drift = device.launch(view_drift, groups, (_GROUP,), **light)
        self._frames = 0

    def __call__(self) -> None:
        """Enqueue the drift towards the frame whose silhouettes and marks are on the device."""
        self._adapt.set(phase=self._frames % PERIOD)
        self._adapt()
        self._view_drift()
        self._frames += 1


def rates(config: SilhouetteConfig) -> tuple[float, float]:
    """Share of the difference that a pixel's mean and variance take on each time."""
    mean, variance = (1 - (1 - r) ** PERIOD for r in (config.adapt, config.adapt / SLOWER))
    return mean, variance
