"""Reconstruction of voxels from a frame's pictures, on one device."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from cl import Array, Device, InputError
from cl.staging import Uploads
from psfs.background.gaussian import Background
from psfs.cameras.camera import CameraRig
from psfs.sequence import Frame, frame_input
from psfs.silhouettes.appearance import follows, looks_again
from psfs.silhouettes.silhouette import Silhouette
from psfs.voxels.body_prior import BodyLocation, TrackedBody, pack_body
from psfs.voxels.bricks import Bricks
from psfs.voxels.config import ReconstructionConfig
from psfs.voxels.device_voxels import Voxels, find_pictures
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.moving_grid import GridFollower
from psfs.voxels.sparse import SparseSurface


class Reconstructor:
    """Probabilistic shape from silhouette: `voxels = reconstructor(frame)`.

    If `background` is None, the frames' masks are the silhouettes. A call only enqueues work;
    nothing is copied to the host until `voxels.cloud()` is called.

    Only the bricks that can be occupied are computed (see `SparseSurface`). follow: move the grid
    with the person along x and y, by whole voxels. This copies 16 bytes to the host per frame, and
    the grid needs to be only as large as the person, not the room (see `GridFollower`). body: a
    tracked body as a prior, from a first pass (see `psfs.voxels.body_prior`).

    The appearance model of the silhouettes is fitted to every frame for the next one (see
    `Foreground`), unless `AppearanceConfig.learn` is off. The first frame is reconstructed again,
    with the model, `AppearanceConfig.first_looks` times; a frame after a gap once, unless
    `AppearanceConfig.look_again` is off.
    """

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        grid: VoxelGrid,
        background: Background | None,
        config: ReconstructionConfig | None = None,
        *,
        follow: bool = False,
        body: TrackedBody | None = None,
    ) -> None:
        config = config or ReconstructionConfig()
        self.device, self.rig, self.config = device, rig, config
        self.silhouette = Silhouette(device, rig, background, config.silhouette)
        maps, step = self.silhouette.evidence, config.silhouette.evidence.step
        self.body = body
        self._packed_body, prior = self._attach_body()
        self._bricks = Bricks(device, rig, grid, maps, step, config.occupancy, body=prior)
        self.surface = SparseSurface(self._bricks)
        pictures = find_pictures(self.silhouette)
        self.voxels = Voxels(device, rig, grid, maps, self.surface, pictures)
        self._follower = GridFollower(device, grid, self.surface.list) if follow else None
        self._uploads: Uploads | None = None
        self._ahead: Frame | None = None

    def _attach_body(self) -> tuple[Array | None, Array | None]:
        """Return the packed body, and the same if it is the voxels' prior: where it is not that of
        the silhouettes."""
        self._body_location: BodyLocation | None = None
        if self.body is None:
            return None, None
        size = (self.body.cones.shape[1] + 1, self.body.cones.shape[2])
        packed = self.device.zeros(size, np.float32, "the tracked body")
        foreground = self.silhouette.foreground
        if foreground is None:
            return packed, packed
        self._body_location = BodyLocation(self.device, self.rig, foreground.prior.location, packed)
        return packed, None

    @property
    def grid(self) -> VoxelGrid:
        return self.voxels.grid

    def evidence(self) -> np.ndarray:
        """Download the evidence maps (V, H, W) int8 that the latest frame was carved with; above 0
        is foreground."""
        return self.silhouette.evidence.get()

    def move_to(self, grid: VoxelGrid) -> None:
        """Use another grid from the next frame on. Raises InputError if its shape differs."""
        if grid.shape != self.grid.shape:
            raise InputError(f"the new grid has shape {grid.shape}; expected {self.grid.shape}")
        self._bricks.move_to(grid)
        self.voxels.grid = grid

    def restart(self) -> None:
        """Forget all frames: the results of the next ones are bit by bit those of a new
        reconstructor."""
        if self._ahead is not None and self._uploads is not None:
            self._uploads.finish()
        self._ahead, self.voxels.frame = None, None
        self.silhouette.restart()

    def prepare(self, frame: Frame) -> None:
        """Start the upload of the next call's frame on a second queue.

        The frame's pictures must not change until that call. Raises InputError as a call does.
        """
        if self._uploads is None:
            self._uploads = Uploads(self.device, self.silhouette.input)
        self._uploads.start(frame_input(frame, self.silhouette.background))
        self._ahead = frame

    def __call__(self, frame: Frame) -> Voxels:
        """Enqueue the reconstruction of `frame`. Raises InputError if it lacks the needed pictures
        or masks."""
        if self._follower is not None and self.voxels.frame is not None:
            moved = self._follower(self.grid)
            if moved is not self.grid:
                self.move_to(moved)
        before, foreground = self.voxels.frame, self.silhouette.foreground
        appearance = self.config.silhouette.appearance
        new = before is None or not follows(before.index, frame.index, appearance)
        if foreground is not None and new:
            foreground.forget_location()
        if self.body is not None and self._packed_body is not None:
            self._packed_body.set(pack_body(self.config, self.body[frame.index]))
        if self._uploads is not None and frame is self._ahead:
            self._uploads.finish()
        else:
            self.silhouette.input.set(frame_input(frame, self.silhouette.background))
        self._ahead, self.voxels.frame = None, frame
        self._carve()
        if foreground is not None:
            for _ in range(looks_again(before is None, new, appearance)):
                foreground.learn(self.voxels)
                self._carve()
            foreground.learn(self.voxels)
        return self.voxels

    def _carve(self) -> None:
        if self._body_location is not None:
            self._body_location()
        self.silhouette.compute()
        self.surface()

    def stream(self, frames: Iterable[Frame]) -> Iterator[Voxels]:
        """Yield the voxels of every frame; the next frame is uploaded while the device computes."""
        ahead = iter(frames)
        frame = next(ahead, None)
        while frame is not None:
            voxels = self(frame)
            self.device.queue.flush()
            frame = next(ahead, None)
            if frame is not None:
                self.prepare(frame)
            yield voxels
