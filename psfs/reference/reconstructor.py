"""The NumPy twin of `psfs.reconstructor.Reconstructor`."""

from __future__ import annotations

from functools import partial

import numpy as np

from cl import Device, InputError, NumpyDevice
from psfs.background.chroma_key import ChromaKey
from psfs.background.gaussian import Background
from psfs.cameras.camera import BLOCK, CameraRig
from psfs.cameras.rig_geometry import cell_rays
from psfs.common.cones import cone_distances, ray_cone_distances
from psfs.common.system import physical_memory
from psfs.reference.appearance import NumpyForeground
from psfs.reference.light import estimate_light
from psfs.reference.reprojection import hide
from psfs.reference.silhouette import mask_evidence, silhouette_evidence
from psfs.reference.surface import BodyEvidence, occupancy, smooth, surface_colour, surface_voxels
from psfs.sequence import Frame, frame_input
from psfs.silhouettes.appearance import follows, looks_again
from psfs.silhouettes.config import SilhouetteConfig
from psfs.voxels.body_prior import (
    EDGE,
    LOW_WIDTH,
    WIDTH,
    TrackedBody,
    body_counts,
    find_low_cones,
    location_counts,
)
from psfs.voxels.config import ReconstructionConfig
from psfs.voxels.grid import VoxelGrid, check_size
from psfs.voxels.host_voxels import HostVoxels


def body_evidence(points: np.ndarray, cones: np.ndarray, step: float) -> np.ndarray:
    """Return the counts (N,) of `step` nats that a body with cones (C, 16), NaN where they are
    unknown, adds to voxels at `points` (N, 3) m."""
    inside, outside, known = body_counts(cones, step)
    nearest = np.full(len(points), np.inf)
    if len(known):
        for first in range(0, len(points), BLOCK):
            lot = slice(first, first + BLOCK)
            nearest[lot] = cone_distances(points[lot], known).min(1)
    within = np.clip((EDGE - nearest) / (2 * EDGE), 0, 1)
    return np.rint(outside + within * (inside - outside))


def body_location(
    rig: CameraRig, cones: np.ndarray, config: ReconstructionConfig
) -> np.ndarray | None:
    """Return the location prior (V, rows, columns) int8, counts of `ratio_steps`, of a body with
    cones (C, 16), NaN where they are unknown, None if all are."""
    steps = config.silhouette.evidence.ratio_steps
    inside, outside = location_counts(cones, steps)
    known = cones[np.isfinite(cones).all(-1)]
    odds: list[np.ndarray] = []
    if not len(known):
        return None
    low = find_low_cones(known, config.silhouette.floor.height)
    for camera, rays in zip(rig, cell_rays(rig), strict=True):
        distances = ray_cone_distances(camera.centre, rays.reshape(-1, 3), known)
        distances = np.nan_to_num(distances, nan=np.inf)
        width = np.where(low & (distances < 0), LOW_WIDTH, WIDTH)
        counts = (-steps * distances / width).max(1)
        odds.append(np.rint(np.clip(counts, outside, inside)).reshape(rays.shape[:2]))
    return np.stack(odds).astype(np.int8)


#: Peak memory of the float64 computation, measured.
_BYTES_PER_VOXEL = 220


class NumpyReconstructor:
    """The same signature and results as `Reconstructor`, computed in float64 and without a
    queue."""

    def __init__(
        self,
        device: Device | NumpyDevice,
        rig: CameraRig,
        grid: VoxelGrid,
        background: Background | None,
        config: ReconstructionConfig | None = None,
        *,
        body: TrackedBody | None = None,
    ) -> None:
        self.device, self.rig, self.grid, self.background = device, rig, grid, background
        self.config = config or ReconstructionConfig()
        silhouette = self.config.silhouette
        scene = background is not None and not isinstance(background, ChromaKey)
        learning = scene and silhouette.appearance.learn
        self.foreground = NumpyForeground(rig, silhouette) if learning else None
        self.body = body
        self._before: int | None = None
        self._latest = np.zeros((len(rig), rig.height, rig.width), np.int8)
        self.frame: Frame | None = None
        check_size(grid)
        needed, there = _BYTES_PER_VOXEL * grid.size, physical_memory()
        if needed > there:
            raise InputError(
                f"a grid of {grid.size:,} voxels needs {needed / 2**20:,.0f} MiB, but this "
                f"machine has {there / 2**20:,.0f} MiB"
            )

    def evidence(self) -> np.ndarray:
        """Return (V, H, W) int8: the evidence maps that the latest frame was carved with."""
        return self._latest

    def __call__(self, frame: Frame) -> HostVoxels:
        before, self._before = self._before, frame.index
        appearance = self.config.silhouette.appearance
        new = before is None or not follows(before, frame.index, appearance)
        if self.foreground is None:
            return self._carve(frame, self._evidence(frame))
        assert frame.images is not None
        if new:
            self.foreground.forget_location()
        evidence = self._evidence(frame)
        voxels = self._carve(frame, evidence)
        for _ in range(looks_again(before is None, new, appearance)):
            self.foreground.learn(frame.images, evidence, self.grid, voxels.surface)
            evidence = self._evidence(frame)
            voxels = self._carve(frame, evidence)
        self.foreground.learn(frame.images, evidence, self.grid, voxels.surface)
        return voxels

    def _evidence(self, frame: Frame) -> np.ndarray:
        config, light = self.config.silhouette, self._light(frame)
        if self.body is not None and self.foreground is not None:
            location = body_location(self.rig, self.body[frame.index], self.config)
            if location is not None:
                self.foreground.location = location
        return frame_evidence(frame, self.rig, self.background, config, self.foreground, light)

    def _light(self, frame: Frame) -> np.ndarray | None:
        """Return the frame's light (V, LIGHT_FLOATS); None if its silhouettes need none."""
        if (
            frame.images is None
            or self.background is None
            or isinstance(self.background, ChromaKey)
        ):
            return None
        config = self.config.silhouette
        return estimate_light(
            frame.images, self.rig, self.background, config.light, config.background
        )

    def _carve(self, frame: Frame, evidence: np.ndarray) -> HostVoxels:
        self._latest, self.frame = evidence, frame
        body = None
        if self.body is not None and self.foreground is None:
            step = self.config.silhouette.evidence.step
            body = partial(body_evidence, cones=self.body[frame.index], step=step)
        return carve_voxels(self.rig, self.grid, frame, evidence, self.config, body)


def carve_voxels(
    rig: CameraRig,
    grid: VoxelGrid,
    frame: Frame,
    evidence: np.ndarray,
    config: ReconstructionConfig,
    body: BodyEvidence | None = None,
) -> HostVoxels:
    """Return the voxels of a frame with evidence maps (V, H, W) int8; body: see `occupancy`."""
    step = config.silhouette.evidence.step
    padded = occupancy(rig, grid, evidence, step, config.occupancy, body=body)
    probability = smooth(padded, config.occupancy.smoothing == "faces")
    occupied = probability > config.occupancy.threshold
    surface = surface_voxels(occupied, config.occupancy.closed_surface)
    colours = None
    if frame.images is not None:
        colours = partial(surface_colour, rig, grid, surface, frame.images, evidence)
    count = int(occupied.sum())
    return HostVoxels(grid, probability, surface, count, colours, evidence, frame.images)


def frame_evidence(
    frame: Frame,
    rig: CameraRig,
    background: Background | None,
    config: SilhouetteConfig,
    foreground: NumpyForeground | None = None,
    light: np.ndarray | None = None,
) -> np.ndarray:
    """Return evidence counts (V, H, W) int8 of a frame: of its masks if there is no background."""
    pictures = frame_input(frame, background)
    if background is None:
        return hide(mask_evidence(pictures, rig, config), rig.hidden)
    evidence = silhouette_evidence(pictures, rig, background, config, foreground, light)
    return hide(evidence, rig.hidden)
