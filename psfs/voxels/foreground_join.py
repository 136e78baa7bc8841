"""Union of the voxels' silhouettes with the pictures' foreground around them."""

from __future__ import annotations

import numpy as np

from cl import Array, Device, Kernel, Launch
from cl.workgroups import GROUP, row_group, size_defines
from psfs.cameras.camera import CameraRig

#: Edge of a cell, px: the silhouettes are marked per cell, and a cell's 64 pixels are the bits of a
#: word.
MARK = 8
#: Enlargement of the box around the silhouette, as a share of its height, %: at both sides and
#: above, as far as a missing arm reaches; below, less, because of shadows.
SIDES, BELOW = 35, 5
#: Least number of foreground pixels among 24 x 24 that do not count as speckle.
LEAST_PIXELS = 40


class ForegroundJoin:
    """`join(evidence)`: addition of foreground in the evidence maps (V, H, W) int8 to the
    silhouettes.

    Foreground counts in and around the box of each silhouette in `silhouette`, which `Reprojection`
    holds.

    A single camera that takes a voxel for background carves it away, so an arm before a wall of its
    colour is missing from the voxels and thereby from all reprojected silhouettes. Most cameras'
    evidence still shows it. Kernel: foreground_join.cl; twin: reference/reprojection.py.
    """

    def __init__(self, device: Device, rig: CameraRig, silhouette: Array) -> None:
        self.device, self._views, self._picture = device, len(rig), rig.picture
        self._n_cells = -(-rig.width // MARK) * -(-rig.height // MARK)
        self._defines = {
            **size_defines(device, rig.picture),
            "MARK": MARK,
            "GROUP": GROUP if device.is_gpu else 1,
        }
        self._silhouette = silhouette.view(np.uint8)
        self._boxes = device.empty((len(rig), 4), np.int32, "the persons' boxes")
        shape = (len(rig), self._n_cells)
        self._bits = device.empty(shape, np.uint64, "the foreground's cells")
        group = self._defines["GROUP"]
        self._box = device.launch(
            self._kernel("person_box"),
            (group, len(rig)),
            (group, 1),
            picture=self._picture,
            sides=SIDES,
            below=BELOW,
            silhouette=self._silhouette,
            boxes=self._boxes,
        )
        self._join = device.launch(
            self._kernel("join_foreground"),
            *self._size(),
            picture=self._picture,
            least=LEAST_PIXELS,
            boxes=self._boxes,
            bits=self._bits,
            silhouette=self._silhouette,
        )
        self._evidence: Array | None = None

    def __call__(self, evidence: Array) -> None:
        """Enqueue the join of `evidence` (V, H, W) int8, above 0 where foreground is likelier."""
        if evidence is not self._evidence:
            self._evidence = evidence
            self._take = self._bits_launch(evidence)
        self._box()
        self._take()
        self._join()

    def _bits_launch(self, evidence: Array) -> Launch:
        return self.device.launch(
            self._kernel("foreground_bits"),
            *self._size(),
            picture=self._picture,
            evidence=evidence,
            boxes=self._boxes,
            bits=self._bits,
        )

    def _size(self) -> tuple[tuple[int, int], tuple[int, int]]:
        local = row_group(self.device)[0]
        return (self._n_cells, self._views), (local, 1)

    def _kernel(self, name: str) -> Kernel:
        return self.device.kernel("reconstruction/foreground_join", name, **self._defines)
