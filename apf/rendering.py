"""Rendering of all hypotheses in all cameras on the device (kernel: render.cl)."""

from __future__ import annotations

from typing import Any

import numpy as np

from apf.body import BodyModel
from apf.kinematics import Kinematics
from cl import Array, Device, Launch
from psfs.camera import CameraRig

#: Work-items of a group: rows of a picture. A CPU does them one after the other anyway.
_ROWS = 128


class FlatRenderer:
    """Draws the cones of `body` as trapezoids (Rymut 2016, 4.3) and counts their pixels.

    Cones that are not to be looked for in images cover their pixels, but show no edges.
    labels: (C,) int32 segment of each cone, from 0, for counts by segment. counts: device array
    (V, N, 2 + 2 L) int32 that the launches of `launcher` fill: visible edge pixels, the sum of the
    edge proximity there, then per segment the model's pixels and their overlap with the silhouette
    (eq. 4.36-4.40).
    """

    def __init__(
        self, device: Device, body: BodyModel, rig: CameraRig, n: int, labels: np.ndarray
    ) -> None:
        self.device, self.rig, self.n_hypotheses = device, rig, n
        self.n_parts, self.n_labels = len(body.cones), int(labels.max()) + 1
        self._kinematics = Kinematics(device, body, n)
        self._cameras = device.to_device(rig.packed(), "the cameras")
        edged = [cone.in_images for cone in body.cones]
        table = np.stack([labels, edged], -1).astype(np.int32)
        self._labels = device.to_device(table, "the labels")
        shape = (len(rig), n, 2 + 2 * self.n_labels)
        self.counts = device.empty(shape, np.int32, "the counted pixels")

    def launcher(
        self,
        poses: Array,
        roi: Array,
        silhouettes: Array,
        proximity: Array,
        pictures: Array | None = None,
    ) -> list[Launch]:
        """The launches that count `poses` (N, D), arguments set.

        roi: (V, 4) int32, ends excluded. silhouettes: (V, L, H, words) uint32, bit i of word w is
        pixel 32 w + i. proximity: (V, H, W) uint8. pictures: (N, V, H, W, 2) uint8, where given,
        gets the number of the part seen, from 1, and 255 on edges; nothing elsewhere.
        """
        rows = _ROWS if self.device.is_gpu else 1
        drawn = () if pictures is None else (pictures,)
        count = self.device.launch(
            self._kernel("count_pixels", rows, bool(drawn)),
            (self.n_hypotheses * rows, len(self.rig)),
            (rows, 1),
            np.int32(self.n_hypotheses),
            np.int32(self.rig.height),
            self._kinematics.cones,
            self._cameras,
            roi,
            self._labels,
            silhouettes,
            proximity,
            self.counts,
            *drawn,
        )
        return [*self._kinematics.launcher(poses), count]

    def _kernel(self, name: str, rows: int, drawn: bool) -> Any:
        defines = {"DRAW": 1} if drawn else {}
        return self.device.kernel(
            "render",
            name,
            N_PARTS=self.n_parts,
            N_LABELS=self.n_labels,
            WIDTH=self.rig.width,
            GROUP=rows,
            **defines,
        )


def draw_hypotheses(
    device: Device, body: BodyModel, rig: CameraRig, poses: np.ndarray
) -> np.ndarray:
    """Pictures (N, V, H, W, 2) uint8 of `poses` (N, D): the number of the cone seen, from 1 (0 is
    background), and 255 on edges. The very pixels that an `ImageObjective` counts."""
    n, shape = len(poses), (len(rig), rig.height, rig.width)
    renderer = FlatRenderer(device, body, rig, n, np.zeros(len(body.cones), np.int32))
    pictures = device.zeros((n, *shape, 2), np.uint8, "the pictures")
    silhouettes = device.zeros((*shape[:2], -(-shape[2] // 32)), np.uint32, "the silhouettes")
    proximity = device.zeros(shape, np.uint8, "the edge proximity")
    roi = device.to_device(whole_pictures(rig), "the regions of interest")
    on_device = device.to_device(np.asarray(poses, np.float32), "the poses")
    for launch in renderer.launcher(on_device, roi, silhouettes, proximity, pictures):
        launch()
    return pictures.get()


def whole_pictures(rig: CameraRig) -> np.ndarray:
    """(V, 4) int32 regions of interest that hold each camera's whole picture."""
    return np.array([(0, 0, *camera.size) for camera in rig], np.int32)
