"""The stages of the reconstruction on either device: kernels on OpenCL, twins on NumPy.

The only module beside tests and benchmarks that imports `psfs.reference`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from cl import Device, NumpyDevice
from cl.staging import Download
from psfs.background.gaussian import Background
from psfs.cameras.camera import CameraRig
from psfs.reconstructor import Reconstructor
from psfs.reference.reconstructor import NumpyReconstructor, frame_evidence
from psfs.sequence import Frame, frame_input
from psfs.silhouettes.config import SilhouetteConfig
from psfs.silhouettes.silhouette import Silhouette
from psfs.voxels.config import ReconstructionConfig
from psfs.voxels.grid import VoxelGrid

#: What `reconstructor_for` returns.
AnyReconstructor = Reconstructor | NumpyReconstructor


def reconstructor_for(
    device: Device | NumpyDevice,
    rig: CameraRig,
    grid: VoxelGrid,
    background: Background | None,
    config: ReconstructionConfig | None = None,
    *,
    sparse: bool = False,
) -> AnyReconstructor:
    """Return the reconstructor of `device`: that of OpenCL, or its twin, which has no modes."""
    if isinstance(device, NumpyDevice):
        return NumpyReconstructor(device, rig, grid, background, config)
    return Reconstructor(device, rig, grid, background, config, sparse=sparse)


def evidence_for(
    device: Device | NumpyDevice,
    rig: CameraRig,
    background: Background | None,
    config: SilhouetteConfig,
) -> Callable[[Frame], np.ndarray]:
    """Return a function that computes a frame's evidence counts (V, H, W) int8 on the host.

    Nothing is learnt from one frame for the next. The function raises InputError if the frame
    has no pictures, or no masks where `background` is None.
    """
    if isinstance(device, NumpyDevice):
        return lambda frame: frame_evidence(frame, rig, background, config)
    silhouette = Silhouette(device, rig, background, config)
    return lambda frame: silhouette(frame_input(frame, background)).get()


def evidence_ahead(
    device: Device | NumpyDevice,
    rig: CameraRig,
    background: Background | None,
    config: SilhouetteConfig,
) -> Callable[[Frame], Callable[[], np.ndarray]]:
    """Return `evidence_for` in two steps: a function that has a frame computed, and returns one
    that waits for it and returns the counts, which a device overwrites with the next but one.

    Who does something else in between leaves the device its time; a GPU's driver keeps a core busy
    with waiting.
    """
    if isinstance(device, NumpyDevice):
        evidence_of = evidence_for(device, rig, background, config)
        return lambda frame: partial(evidence_of, frame)
    silhouette = Silhouette(device, rig, background, config)
    download = Download(silhouette.evidence)

    def begin(frame: Frame) -> Callable[[], np.ndarray]:
        silhouette(frame_input(frame, background))
        fetched = download.fetch()
        device.queue.flush()
        return fetched

    return begin
