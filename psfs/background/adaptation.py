"""Adaptation of the background to slow local changes, away from the person, on the device."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from cl import Array, Device
from cl.workgroups import pixel_pack, row_group, size_defines
from psfs.background.config import AdaptationConfig, BackgroundConfig
from psfs.cameras.camera import CameraRig
from psfs.cameras.cells import CELL, cells


@dataclass(frozen=True, eq=False)
class AdaptationArrays:
    """The kernel's arrays on the device.

    images: (V, H, W, 3) uint8 pictures. evidence: (V, H, W) int8. near: (V, rows, columns) uint8
    of the cells near those that show voxels. sizes: (V, 2) int32 of
    the pictures. light: (V, LIGHT_FLOATS) float32 of the frame. background: (V, 8, H, W) float32,
    which is updated, see `background_planes`.
    """

    images: Array
    evidence: Array
    near: Array
    sizes: Array
    light: Array
    background: Array


class Adaptation:
    """`adaptation()`: exponential moving update of the background's mean and variance, by
    `config.rate` of the difference to the frame on the device (Song et al. eq. (1) with exponential
    forgetting).

    Only pixels that look much like the background are updated, and none with a voxel within two
    cells or foreground in the same cell. So a person who keeps still does not become background.
    The background is updated in its own light: the frame's light is removed first.
    """

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        config: AdaptationConfig,
        background: BackgroundConfig,
        arrays: AdaptationArrays,
    ) -> None:
        rows, _ = cells(rig)
        blocks = -(-rig.width // max(CELL, pixel_pack(device, rig.width)))
        parts = _parts(device)
        size = (blocks, parts * -(-rows // config.period), len(rig))
        defines = _defines(device, rig, config, background)
        adapt = device.kernel("reconstruction/adaptation", "adapt", **defines)
        # Each phase has its own launch, created on first use: setting an argument takes longer than
        # the launch itself.
        self._of_phase = cache(
            partial(
                device.launch,
                adapt,
                size,
                row_group(device),
                picture=rig.picture,
                rates=config.rates(),
                **vars(arrays),
            )
        )
        self._period, self._frames = config.period, 0
        self._planes = arrays.background

    def __call__(self) -> None:
        """Enqueue the update by the frame whose silhouettes and voxels are on the device."""
        self._of_phase(phase=self._frames % self._period)()
        self._frames += 1

    def restart(self, planes: np.ndarray) -> None:
        """Start again from `planes`, see `background_planes`."""
        self._planes.set(planes)
        self._frames = 0


def _parts(device: Device) -> int:
    """Return the number of work-items that share a block: a GPU needs more, to hide memory
    latency."""
    return CELL if device.is_gpu else 1


def _defines(
    device: Device, rig: CameraRig, config: AdaptationConfig, background: BackgroundConfig
) -> dict[str, int | float]:
    """Return the definitions of adaptation.cl."""
    return {
        **size_defines(device, rig.picture),
        "CELL": CELL,
        **{"PARTS": _parts(device), "PACK": pixel_pack(device, rig.width)},
        "PERIOD": config.period,
        "NEAREST": float(config.nearest),
        "LEAST_VARIANCE": float(background.sigma_floor**2),
        "WIDTH_GREY": float(background.shadow_width_grey),
        "WIDTH_COLOUR": float(background.shadow_width_colour),
    }
