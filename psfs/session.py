"""One take on one device, with the results of its stages, each computed once for all stages that
need it.

A stage is a function of a session and of the results of earlier stages. Its result is kept in the
session, so that a second call returns it without computing it again.
"""

from __future__ import annotations

import math
import zlib
from collections import OrderedDict
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator
from collections.abc import Sequence as Items
from concurrent.futures import Future, ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, TypeVar, cast

import numpy as np

from cl import Device, InputError, NumpyDevice
from psfs.backend import AnyReconstructor, make_evidence_function, make_reconstructor
from psfs.background.gaussian import Background
from psfs.cameras.camera import CameraRig
from psfs.common.progress import map_in_threads
from psfs.common.system import KEPT_BYTES
from psfs.reconstructor import Reconstructor
from psfs.sequence import Frame, Sequence
from psfs.silhouettes.hidden import UNKNOWN
from psfs.voxels.body_prior import TrackedBody
from psfs.voxels.config import ReconstructionConfig
from psfs.voxels.device_voxels import Voxels
from psfs.voxels.grid import VoxelCloud, VoxelGrid
from psfs.voxels.host_voxels import HostVoxels

R = TypeVar("R")


@dataclass(frozen=True)
class SessionSettings:
    """Settings that all stages of a session share."""

    reconstruction: ReconstructionConfig = field(default_factory=ReconstructionConfig)
    """Settings of silhouettes, volume and voxels."""
    selection: slice = field(default_factory=lambda: slice(None))
    """Frames of the sequence to process; all by default."""
    voxel_size: float | None = None
    """Edge of a voxel, m. By default 2 cm for people, see `psfs.volume.automatic_grid`."""


@dataclass(frozen=True, eq=False)
class CarvedFrame:
    """A reconstructed frame: the silhouettes (V, H, W) bool that it was carved with, the mask (V,
    H, W) bool of pixels where they are known (elsewhere furniture hides what is behind it), and the
    surface voxels."""

    index: int
    silhouettes: np.ndarray
    known: np.ndarray
    cloud: VoxelCloud


class FrameReconstructor(Protocol):
    """What a stage needs of a reconstructor: the voxels of a frame, and the evidence maps (V, H, W)
    int8 that the latest was carved with."""

    @property
    def grid(self) -> VoxelGrid: ...

    def evidence(self) -> np.ndarray: ...

    def __call__(self, frame: Frame, /) -> Voxels | HostVoxels: ...


class Session:
    """A sequence on a device, with the results of the stages on its footage.

    device: computes, and belongs to the caller. sequence: gives rig, frames and background.
    settings: see `SessionSettings`. background: the empty scene, the sequence's own until a stage
    revises it.
    """

    def __init__(
        self,
        sequence: Sequence,
        device: Device | NumpyDevice,
        settings: SessionSettings | None = None,
    ) -> None:
        self.sequence, self.device = sequence, device
        self.settings = settings or SessionSettings()
        self._background: Background | None = None
        self._results: dict[Hashable, Any] = {}
        self._evidence_of: Callable[[Frame], np.ndarray] | None = None
        self._evidence: OrderedDict[int, np.ndarray] = OrderedDict()
        self._reconstructor: AnyReconstructor | None = None
        self._carved: _CarvedFrames | None = None

    @property
    def rig(self) -> CameraRig:
        """The calibrated cameras."""
        return self.sequence.rig

    @property
    def has_images(self) -> bool:
        """Whether frames have pictures, not masks only."""
        return self.sequence.has_images

    @property
    def reconstruction(self) -> ReconstructionConfig:
        """Settings of silhouettes, volume and voxels."""
        return self.settings.reconstruction

    @property
    def frames(self) -> range:
        """Numbers of the selected frames."""
        return range(len(self.sequence))[self.settings.selection]

    @property
    def rate(self) -> float:
        """Selected frames per second."""
        return self.sequence.fps / abs(self.settings.selection.step or 1)

    @property
    def background(self) -> Background | None:
        """The current estimate of the empty scene; None if frames come with masks."""
        return self._background or self.sequence.background

    def revise_background(self, background: Background) -> None:
        """Replace the background by a stage's estimate.

        Later evidence is computed with it. Evidence that was computed before is dropped; the
        results of stages are kept.
        """
        self._background = background
        self._evidence_of, self._reconstructor, self._carved = None, None, None
        self._evidence.clear()

    def with_sequence(self, sequence: Sequence) -> Session:
        """Return a session on another sequence, such as the same one without some cameras, with the
        same device and settings. Frames are kept in memory if this session keeps them."""
        if sequence is self.sequence:
            return self
        if self.sequence.keeps_frames and not sequence.keeps_frames:
            sequence.keep_frames()
        return Session(sequence, self.device, self.settings)

    def with_frames(self, frames: range) -> Session:
        """Return a session on these frames, with the results and the reconstructor of this one; on
        the same frames itself."""
        if frames == self.frames:
            return self
        stop = frames.stop if frames.stop >= 0 else None
        other = copy(self)
        selection = slice(frames.start, stop, frames.step)
        other.settings = replace(self.settings, selection=selection)
        other._results = dict(self._results)
        return other

    def compute_once(self, key: Hashable, compute: Callable[[], R]) -> R:
        """Return the result kept under `key`, and compute it if there is none yet."""
        if key not in self._results:
            self._results[key] = compute()
        return cast(R, self._results[key])

    def replace_result(self, key: Hashable, result: object) -> None:
        """Keep `result` under `key` in place of the computed one."""
        self._results[key] = result

    def evidence(self, indices: Iterable[int]) -> list[np.ndarray]:
        """Return the evidence (V, H, W) int8 of each frame of `indices`, computed independently of
        other frames. The latest are kept in memory. Raises InputError as `Sequence.reader` does."""
        wanted = list(indices)
        found = {index: self._evidence[index] for index in wanted if index in self._evidence}
        missing = [index for index in dict.fromkeys(wanted) if index not in found]
        if missing:
            if self._evidence_of is None:
                self._evidence_of = make_evidence_function(
                    self.device, self.rig, self.background, self.reconstruction.silhouette
                )
            with self.sequence.reader(learning=False) as read:
                for index in missing:
                    found[index] = self._evidence_of(read(index))
        for index in missing:
            self._evidence[index] = found[index]
        while sum(of.nbytes for of in self._evidence.values()) > KEPT_BYTES:
            self._evidence.popitem(last=False)
        return [found[index] for index in wanted]

    def reconstructor(self, grid: VoxelGrid, body: TrackedBody | None = None) -> FrameReconstructor:
        """Return the reconstructor of `grid`, in its initial state. body: a tracked body as
        a prior of the voxels.

        All stages share one reconstructor: the next stage overwrites the arrays that it computed
        for this one.
        """
        known = self._reconstructor
        if isinstance(known, Reconstructor) and known.body is body and known.grid.congruent(grid):
            known.restart()
            known.move_to(grid)
            return known
        # Free their memory before the next reconstructor is created.
        self._reconstructor = self._evidence_of = None
        self._reconstructor = make_reconstructor(
            *(self.device, self.rig, grid, self.background, self.reconstruction),
            body=body,
        )
        return self._reconstructor

    def iterate_clouds(self, grid: VoxelGrid, indices: Items[int]) -> Iterator[VoxelCloud]:
        """Yield the surface voxels of the frames of `indices`. Raises InputError as
        `Sequence.reader` does."""
        reconstruct = self.reconstructor(grid)
        with self.sequence.reader(learning=False) as read:
            for index in indices:
                yield reconstruct(read(index)).cloud()

    def keep_carved(self, indices: Collection[int]) -> None:
        """Keep the frames of these numbers when the next stage passes them to `record_carved`."""
        self._carved = _CarvedFrames(frozenset(indices))

    def record_carved(self, index: int, voxels: Voxels | HostVoxels) -> None:
        """Keep frame `index` as it was carved, if `keep_carved` named it."""
        if self._carved is not None:
            self._carved.add(index, voxels, self.sequence.has_images)

    def iterate_carved(self, grid: VoxelGrid, indices: Items[int]) -> Iterator[CarvedFrame]:
        """Yield the frames of `indices` as they were carved in `grid`.

        If all were kept, they are returned; otherwise all are reconstructed again, in their order.
        """
        if self._carved is not None and self._carved.holds(grid, indices):
            yield from map_in_threads(self._carved.get, indices)
            return
        reconstruct = self.reconstructor(grid)
        for frame in self.sequence.select_frames(indices):
            voxels = reconstruct(frame)
            evidence, cloud = reconstruct.evidence(), voxels.cloud(colour=frame.images is not None)
            yield CarvedFrame(frame.index, evidence > 0, evidence != UNKNOWN, cloud)


class _CarvedFrames:
    """Carved frames with silhouettes stored as compressed bits, by a thread. If they exceed
    `KEPT_BYTES`, all are dropped and no more are kept."""

    def __init__(self, wanted: frozenset[int]) -> None:
        self._wanted, self._n_bytes = wanted, 0
        self._pool, self._last = ThreadPoolExecutor(1), Future[None]()
        self._last.set_result(None)
        self._shape: tuple[int, ...] = ()
        self._frames: dict[int, tuple[bytes, bytes, VoxelCloud]] = {}

    def add(self, index: int, voxels: Voxels | HostVoxels, colour: bool) -> None:
        counts = voxels.download_evidence() if index in self._wanted else None
        if counts is not None:
            cloud = voxels.cloud(colour=colour)
            self._last = self._pool.submit(self._store, index, counts, cloud)

    def _store(self, index: int, counts: np.ndarray, cloud: VoxelCloud) -> None:
        shown, known = _compress(counts > 0), _compress(counts != UNKNOWN)
        self._shape = counts.shape
        self._frames[index] = shown, known, cloud
        self._n_bytes += len(shown) + len(known) + cloud.nbytes
        if self._n_bytes > KEPT_BYTES:
            self._wanted = frozenset()
            self._frames.clear()

    def holds(self, grid: VoxelGrid, indices: Items[int]) -> bool:
        """Return whether all frames of `indices` are kept, carved in `grid`."""
        self._last.result()
        frames = self._frames
        return all(i in frames and frames[i][-1].grid.equals(grid) for i in indices)

    def get(self, index: int) -> CarvedFrame:
        shown, known, cloud = self._frames[index]
        return CarvedFrame(index, self._expand(shown), self._expand(known), cloud)

    def _expand(self, compressed: bytes) -> np.ndarray:
        packed = np.frombuffer(zlib.decompress(compressed), np.uint8)
        flat = np.unpackbits(packed, count=math.prod(self._shape)).view(bool)
        return flat.reshape(self._shape)


def _compress(pictures: np.ndarray) -> bytes:
    return zlib.compress(np.packbits(pictures).tobytes(), 1)


def check_frames(session: Session) -> range:
    """Return the numbers of the selected frames. Raises InputError if there is none."""
    if not session.frames:
        raise InputError(
            f"{session.sequence.folder}: the selected frames are none of {len(session.sequence)}"
        )
    return session.frames
