"""Surface voxels of whole sequences, computed once and played to any number of trackers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from apf.api import DEFAULT_BODY
from apf.body import BodyModel, load_body
from apf.evaluation.evaluate import load_truth
from apf.evaluation.joint_names import match_joints
from apf.formats.trc import JointSeries
from apf.image_objective.config import FeatureConfig
from apf.image_objective.features import Features
from apf.initialisation.from_joints import fit_to_joints
from apf.presets import Preset
from cl import Device, InputError
from psfs.cameras.camera import CameraRig
from psfs.common.files import write_atomically
from psfs.reconstructor import Reconstructor
from psfs.sequence import Sequence
from psfs.session import Session, SessionSettings
from psfs.volume import automatic_grid
from psfs.voxels.grid import VoxelCloud, VoxelGrid


@dataclass(frozen=True, eq=False)
class Recording:
    """The surface voxels of every frame of `sequence`, as ascending flat indices in `grid`, and the
    foreground (V H W bits, packed) of the evidence that they were carved with.

    truth: the sequence's true joints. settings: of the reconstruction.
    """

    sequence: Sequence
    grid: VoxelGrid
    frames: list[int]
    surfaces: list[np.ndarray]
    foregrounds: list[np.ndarray]
    truth: JointSeries
    settings: Preset = field(default_factory=Preset)
    _features: dict[FeatureConfig, FeatureReplay] = field(default_factory=dict)

    @property
    def fps(self) -> float:
        """Frame rate of the whole sequence, 1/s."""
        return self.sequence.fps

    @cached_property
    def first_pose(self) -> tuple[BodyModel, np.ndarray]:
        """A body and its pose (D,) fitted to the true joints of the first frame."""
        row = int(np.flatnonzero(self.truth.frames == self.frames[0])[0])
        places = match_joints(self.truth.joint_names)
        joints = {name: self.truth.joints[row, place] for name, place in places.items()}
        body, pose, _ = fit_to_joints(load_body(self.settings.body or DEFAULT_BODY), joints)
        return body, pose

    def features(self, device: Device, config: FeatureConfig) -> FeatureReplay:
        """Return the image features, computed at the first call."""
        if config not in self._features:
            self._features[config] = FeatureReplay(device, self, config)
        return self._features[config]


class Replay:
    """The frames of a recording on a device, in the layout of a reconstructor.

    grid, surface, count, cloud(): as of psfs.voxels.device_voxels.Voxels; the evidence has only its
    sign.
    """

    def __init__(self, device: Device, recording: Recording) -> None:
        self.grid = recording.grid
        self._recording = recording
        room = max(1, *(len(surface) for surface in recording.surfaces))
        self.surface = device.zeros(room, np.int32, "the surface voxels")
        self.count = device.zeros(1, np.int32)
        rig = recording.sequence.rig
        shape = (len(rig), rig.height, rig.width)
        self.evidence = device.zeros(shape, np.int8, "the silhouettes")

    def __iter__(self) -> Iterator[tuple[int, Replay]]:
        """Yield frame numbers, and this object with the frame's voxels."""
        recording = self._recording
        shown = zip(recording.surfaces, recording.foregrounds, strict=True)
        for index, (surface, foreground) in zip(recording.frames, shown, strict=True):
            signs = np.unpackbits(foreground, count=self.evidence.size).view(np.int8)
            self.evidence.set(2 * signs - 1)
            self._shown = surface
            padded = np.zeros(self.surface.size, np.int32)
            padded[: len(surface)] = surface
            self.surface.set(padded)
            self.count.set(np.array([len(surface)], np.int32))
            yield index, self

    def cloud(self) -> VoxelCloud:
        """Return the frame's surface voxels on the host."""
        certain = np.ones(len(self._shown), np.float32)
        return VoxelCloud(self.grid, self._shown.astype(np.int32), certain)


class FeatureReplay:
    """The image features of a recording's frames, computed once and kept on the host. On a device
    they have the layout of `Features`: maps, roi."""

    def __init__(self, device: Device, recording: Recording, config: FeatureConfig) -> None:
        sequence, frames = recording.sequence, recording.frames
        silhouette = recording.settings.reconstruction.silhouette
        features = Features(device, sequence.rig, sequence.background, config, silhouette)
        self.maps, self.roi = features.maps, features.roi
        self._kept: list[tuple[int, np.ndarray, np.ndarray]] = []
        with sequence.reader() as read:
            for index in frames:
                features(read(index))
                self._kept.append((index, self.maps.get(), self.roi.get()))

    def __iter__(self) -> Iterator[tuple[int, FeatureReplay]]:
        """Yield frame numbers, and this object with the frame's features."""
        for index, maps, roi in self._kept:
            self.maps.set(maps)
            self.roi.set(roi)
            yield index, self


def record(
    device: Device,
    folder: Path,
    cameras: int,
    step: int,
    cache: Path,
    progress: Callable[[], object],
    *,
    settings: Preset | None = None,
) -> Recording:
    """Return the recording of a sequence with some of its cameras and every `step`-th frame, by
    `settings`.

    It is stored in the file `cache`, and read from it if that exists. Raises InputError without
    truth.
    """
    settings = settings or Preset()
    sequence = open_for_preset(folder, settings)
    sequence = sequence.with_cameras(spread_cameras(sequence.rig, cameras))
    truth = load_truth(folder / "truth.npz")
    if cache.exists():
        with np.load(cache) as kept:
            grid = VoxelGrid(kept["origin"], float(kept["voxel_size"]), tuple(kept["shape"]))
            frames, surfaces = kept["frames"].tolist(), _split(kept["voxels"], kept["counts"])
            foregrounds = list(kept["foregrounds"])
        return Recording(sequence, grid, frames, surfaces, foregrounds, truth, settings)
    selection = slice(None, None, step)
    config = settings.reconstruction
    grid = automatic_grid(Session(sequence, device, SessionSettings(config, selection)))
    reconstruct = Reconstructor(device, sequence.rig, grid, sequence.background, config)
    frames, surfaces, foregrounds = [], [], []
    for frame in sequence.frames(selection):
        surfaces.append(reconstruct(frame).cloud().indices)
        foregrounds.append(np.packbits(reconstruct.evidence() > 0))
        frames.append(frame.index)
        progress()
    arrays: dict[str, Any] = {
        "origin": grid.origin,
        "voxel_size": grid.voxel_size,
        "shape": np.array(grid.shape),
        "frames": np.array(frames),
        "counts": np.array([len(surface) for surface in surfaces]),
        "voxels": np.concatenate(surfaces),
        "foregrounds": np.stack(foregrounds),
    }
    with write_atomically(cache) as temporary:
        np.savez_compressed(temporary, **arrays)
    return Recording(sequence, grid, frames, surfaces, foregrounds, truth, settings)


def open_for_preset(folder: Path, settings: Preset) -> Sequence:
    """Return the sequence with the background of a preset, if it has images to estimate that
    from."""
    sequence = Sequence.open(folder)
    if settings.background is None or not sequence.has_images:
        return sequence
    return Sequence.open(folder, background=settings.background)


def _split(voxels: np.ndarray, counts: np.ndarray) -> list[np.ndarray]:
    return np.split(voxels, np.cumsum(counts)[:-1])


def spread_cameras(rig: CameraRig, count: int) -> list[str]:
    """Return the names of `count` cameras, evenly spread around the point that they face. Two of
    them are as close to a right angle as possible, because opposite ones see the same outline.
    Raises InputError."""
    if not 1 <= count <= len(rig):
        raise InputError(f"{count} cameras of {', '.join(rig.names)}; expected 1 to {len(rig)}")
    away = rig.centres - rig.centres.mean(0)
    bearings = np.arctan2(away[:, 1], away[:, 0])
    if count == 2:
        bend = np.abs(np.cos(bearings[:, None] - bearings))
        picked = np.unravel_index(np.argmin(bend), bend.shape)
    else:
        order = np.argsort(bearings)
        picked = order[np.linspace(0, len(rig), count, endpoint=False).astype(int)]
    return [rig[int(k)].name for k in sorted(picked)]
