"""The stages of the reconstruction on either device: kernels on OpenCL, twins on NumPy.

The only module beside tests and benchmarks that imports `psfs.reference`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from cl import Device, NumpyDevice
from cl.staging import Download
from psfs.background.gaussian import Background
from psfs.cameras.camera import CameraRig
from psfs.reconstructor import Reconstructor
from psfs.reference.division import NumpyDivision
from psfs.reference.reconstructor import NumpyReconstructor, frame_evidence
from psfs.sequence import Frame, frame_input
from psfs.silhouettes.config import SilhouetteConfig
from psfs.silhouettes.silhouette import Silhouette
from psfs.voxels.body_prior import TrackedBody
from psfs.voxels.config import ReconstructionConfig
from psfs.voxels.device_voxels import Voxels
from psfs.voxels.division import Division, find_bands
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.host_voxels import HostVoxels

#: The result of `make_reconstructor`.
AnyReconstructor = Reconstructor | NumpyReconstructor
#: Divides the latest frame among people, see `make_division`.
Divide = Callable[[np.ndarray, "int | None"], "Sequence[Voxels | HostVoxels]"]


def make_reconstructor(
    device: Device | NumpyDevice,
    rig: CameraRig,
    grid: VoxelGrid,
    background: Background | None,
    config: ReconstructionConfig | None = None,
    *,
    body: TrackedBody | None = None,
) -> AnyReconstructor:
    """Return the reconstructor of `device`: OpenCL's, or its NumPy twin."""
    if isinstance(device, NumpyDevice):
        return NumpyReconstructor(device, rig, grid, background, config, body=body)
    return Reconstructor(device, rig, grid, background, config, body=body)


def make_division(
    device: Device | NumpyDevice,
    reconstructor: AnyReconstructor,
    grids: Sequence[VoxelGrid],
    n_spheres: int,
    colours: np.ndarray | None = None,
) -> Divide:
    """Return a function that divides the latest frame of `reconstructor` among people, one for each
    of `grids`, and returns the voxels of each.

    It takes spheres (P, `n_spheres`, 4) that say where the people are, see
    `psfs.voxels.division.Division`, and the number of the only person who is carved, if not None;
    the others' voxels are then invalid. colours: histograms (P, BANDS,
    LEVELS^3) of each person's, if the frames have pictures.
    """
    rig, config = reconstructor.rig, reconstructor.config
    if isinstance(reconstructor, NumpyReconstructor):
        return NumpyDivision(reconstructor, grids, colours)
    assert isinstance(device, Device)
    division = Division(device, rig, reconstructor.voxels, grids, n_spheres, config, colours)

    def divide(spheres: np.ndarray, person: int | None) -> list[Voxels]:
        division.spheres.set(spheres)
        if division.bands is not None:
            division.bands.set(find_bands(spheres))
        for voxels in division.persons:
            voxels.frame = reconstructor.voxels.frame
        return division(person)

    return divide


def make_evidence_function(
    device: Device | NumpyDevice,
    rig: CameraRig,
    background: Background | None,
    config: SilhouetteConfig,
) -> Callable[[Frame], np.ndarray]:
    """Return a function that computes a frame's evidence counts (V, H, W) int8 on the host.

    Each frame is computed independently. The function raises InputError if the frame has no
    pictures or, if `background` is None, no masks.
    """
    if isinstance(device, NumpyDevice):
        return lambda frame: frame_evidence(frame, rig, background, config)
    silhouette = Silhouette(device, rig, background, config)
    return lambda frame: silhouette(frame_input(frame, background)).get()


def make_evidence_pipeline(
    device: Device | NumpyDevice,
    rig: CameraRig,
    background: Background | None,
    config: SilhouetteConfig,
) -> Callable[[Frame], Callable[[], np.ndarray]]:
    """Return `make_evidence_function` in two steps: a function that enqueues a frame and returns a
    second function, which waits and returns the counts.

    A device overwrites the counts with those of the next frame but one.

    A caller that works between the two steps leaves the device time to compute. Waiting would keep
    a core busy in a GPU's driver.
    """
    if isinstance(device, NumpyDevice):
        evidence_of = make_evidence_function(device, rig, background, config)
        return lambda frame: partial(evidence_of, frame)
    silhouette = Silhouette(device, rig, background, config)
    download = Download(silhouette.evidence)

    def begin(frame: Frame) -> Callable[[], np.ndarray]:
        silhouette(frame_input(frame, background))
        fetched = download.fetch()
        device.queue.flush()
        return fetched

    return begin
