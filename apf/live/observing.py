"""From a live frame's pictures to what the tracker of each person observes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from apf.backend import make_observer
from apf.body.spheres import count_spheres
from apf.filters.method import Method
from apf.likelihood.observations import Shown
from apf.live.config import LiveConfig
from apf.live.person import LivePerson
from apf.live.pictures import Smaller
from cl import Device
from psfs.reconstructor import Reconstructor
from psfs.sequence import Frame
from psfs.voxels.device_voxels import CarvedVoxels
from psfs.voxels.division import Division
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.moving_grid import MeanPosition

#: What a tracker observes, and the centre (3,) m of its voxels; None without voxels.
Seen = tuple[Shown, "np.ndarray | None"]
#: Returns what each person's tracker observes in a frame at a time, s.
Observer = Callable[[Frame, float], list[Seen]]


def observe_features(device: Device, pictures: Smaller, method: Method) -> Observer:
    """Return the observer of image features, of one person."""
    features = make_observer(device, pictures, None, method)
    return lambda frame, time: [(features(pictures(frame)), None)]


@dataclass(frozen=True, eq=False)
class VoxelObserver:
    """Observer of voxels: one reconstruction for all, divided among several persons by where each
    is expected."""

    device: Device
    pictures: Smaller
    reconstruct: Reconstructor
    persons: Sequence[LivePerson]
    parts: Sequence[CarvedVoxels]
    means: Sequence[MeanPosition]
    division: Division | None

    @classmethod
    def create(
        cls,
        device: Device,
        pictures: Smaller,
        grid: VoxelGrid,
        persons: Sequence[LivePerson],
        config: LiveConfig,
        follow: bool,
    ) -> VoxelObserver:
        """Make the observer of `persons`. follow: the grid moves with the only person."""
        reconstruct = Reconstructor(
            device, pictures.rig, grid, pictures.background, config.reconstruction,
            sparse=True, follow=follow,
        )  # fmt: skip
        parts: Sequence[CarvedVoxels] = [reconstruct.voxels]
        division = None
        if len(persons) > 1:
            n_spheres = count_spheres(persons[0].body)
            division = Division(device, pictures.rig, reconstruct.voxels, len(persons), n_spheres)
            parts = division.persons
        means = [MeanPosition(device, grid.shape, part.surface, part.count) for part in parts]
        return cls(device, pictures, reconstruct, persons, parts, means, division)

    def __call__(self, frame: Frame, time: float) -> list[Seen]:
        voxels = self.reconstruct(self.pictures(frame))
        if self.division is not None:
            spheres = [person.expect_spheres(time) for person in self.persons]
            self.division.spheres.set(np.stack(spheres).astype(np.float32))
            self.division()
        seen: list[Seen] = []
        for part, mean_of in zip(self.parts, self.means, strict=True):
            mean = mean_of()
            centre = None if mean is None else voxels.grid.origin + mean * voxels.grid.voxel_size
            seen.append((part, centre))
        return seen
