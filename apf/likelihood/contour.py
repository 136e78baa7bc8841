"""Contours of the pictures along the outlines of limbs (kernels: contour.cl, likelihood.cl).

A silhouette shows the outline of a limb only in front of the background. In front of the trunk, the
outline shows only as a change of grey values in the picture. The term measures the largest change
along the outline's normal within a few pixels (Isard & Blake 1998, section 4).
"""

from __future__ import annotations

import numpy as np

from apf.likelihood.term import Shared, Term
from apf.likelihood.terms import ContourConfig
from cl import Array, Launch
from cl.signature import Argument
from cl.workgroups import PIXELS, row_group
from psfs.voxels.device_voxels import CarvedVoxels

#: Directions along which contours are found: (1, 0), (1, 1), (0, 1) and (-1, 1).
N_NORMALS = 4
#: Search range to either side of an outline, px, and the diagonal steps of about the same length.
REACH, DIAGONAL_REACH = 3, 2
#: Value of a contour hidden by furniture: counts neither as present nor as missing.
HIDDEN = 128
#: Result of the Sobel operator, whose gain is 128 per grey value and pixel, that counts as a full
#: contour: 7.5 grey levels per pixel; 4 do as well, 12 worse.
FULL_CONTRAST = 960
#: Pixels from the border that have no gradient, and no contour.
MARGIN = 2
OUTER_MARGIN = MARGIN + REACH


class Contours(Term):
    """Term that compares the outlines of limbs with the contours of the pictures.

    `contours` (V, 4, H, W) uint8: contours of the latest frame along each of the four normals, zero
    at first. `known`: whether that frame had pictures. The maps (V, H, W, 2) hold the silhouettes
    in the same pictures. Twin: reference/likelihood/contour.py.
    """

    kernels = "tracking/contour"
    uses_pictures = True

    def __init__(self, shared: Shared, settings: ContourConfig) -> None:
        device = shared.scene.opencl
        super().__init__(
            device, REACH=REACH, DIAGONAL_REACH=DIAGONAL_REACH, HIDDEN=HIDDEN, MARGIN=MARGIN,
            OUTER_MARGIN=OUTER_MARGIN, STRIP=PIXELS, **({} if device.is_gpu else {"ANYWHERE": 1}),
        )  # fmt: skip
        self._rig, self._maps, self._settings = shared.scene.rig, shared.maps, settings
        views, *size = len(self._rig), self._rig.height, self._rig.width
        self.contours = shared.seen["contours"][0]  # whose borders stay 0
        self._gradients = device.zeros((views, 2, *size), np.int16, "the pictures' gradients")
        self.known = False
        self._has_room = min(size) >= 2 * OUTER_MARGIN + PIXELS
        self._pictures: Array | None = None
        self._launches: list[Launch] = []

    def observe(self, voxels: CarvedVoxels, pictures: Array | None) -> None:
        """Enqueue the contours of a frame's pictures (V, H, W, 3), whose maps are made."""
        self.known = pictures is not None and self._has_room
        if pictures is None or not self._has_room:
            return
        if pictures is not self._pictures:
            self._pictures, self._launches = pictures, self._contour_launch(pictures)
        for launch in self._launches:
            launch()

    def score_weights(self) -> dict[str, float]:
        return {"contour_weight": self._settings.weight if self.known else 0.0}

    def _contour_launch(self, pictures: Array) -> list[Launch]:
        rig = self._rig
        shape: dict[str, Argument] = {"width": rig.width, "height": rig.height, "maps": self._maps}
        return [
            self.launch(
                "differentiate", self._size(MARGIN), row_group(self.device), **shape,
                pictures=pictures, gradients=self._gradients,
            ),
            self.launch(
                "find_contours", self._size(OUTER_MARGIN),
                row_group(self.device), **shape, contrast=FULL_CONTRAST,
                gradients=self._gradients, contours=self.contours,
            ),
        ]  # fmt: skip

    def _size(self, margin: int) -> tuple[int, int, int]:
        """Return the number of strips in a row, of rows and of cameras."""
        rig = self._rig
        return -(-(rig.width - 2 * margin) // PIXELS), rig.height - 2 * margin, len(rig)
