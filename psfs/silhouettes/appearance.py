"""Appearance model of the person, fitted to each frame for the next frame's silhouettes, on the
device.

By Song et al. 2.2.1 the uniform foreground of eq. (2) is for the first frame only.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from cl import Array, Device, Launch
from cl.signature import Argument
from cl.workgroups import row_group, size_defines
from psfs.cameras.camera import CameraRig
from psfs.cameras.rig_geometry import CELL, cells, voxel_footprints
from psfs.silhouettes.config import AppearanceConfig, SilhouetteConfig

#: Colour bins per channel of the histogram; its table of int8 counts has 32 KiB.
BINS = 32


class Grid(Protocol):
    """The part of a `VoxelGrid` that the appearance model needs."""

    @property
    def origin(self) -> np.ndarray: ...

    @property
    def voxel_size(self) -> float: ...

    @property
    def shape(self) -> tuple[int, int, int]: ...


class SurfaceVoxels(Protocol):
    """Surface voxels on the device: `surface` (capacity,) int32 flat indices into the grid, of
    which the first `count[0]` are valid."""

    @property
    def grid(self) -> Grid: ...

    @property
    def surface(self) -> Array: ...

    @property
    def count(self) -> Array: ...


class ForegroundPrior(NamedTuple):
    """The prior of a frame's silhouettes, on the device, in counts of `EvidenceConfig.ratio_steps`.

    colours: (BINS^3,) int8, log of the person's colour density over the uniform density, from a
    histogram with exponential forgetting. location: (V, rows, columns) int8, log odds of foreground
    in every cell, where the voxels reproject, blurred by the distance that the person may move
    until the next frame.
    """

    colours: Array
    location: Array


class Foreground:
    """The person's colours and location, fitted to the voxels of a frame and used as a prior for
    the silhouettes of the next frame.

    near: (V, rows, columns) uint8, 1 where voxels reproject within `reach` cells. `learn` fills it
    and the `prior`.

    Three rules keep the model from confirming its own errors: only pixels that look like foreground
    and lie where voxels reproject are counted; a frame that looks like foreground all over is
    ignored; colours that were never observed keep a density above 0.
    """

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        config: SilhouetteConfig,
        pictures: Array,
        evidence: Array,
        prior: ForegroundPrior,
    ) -> None:
        self.prior = prior
        self._device, self._rig, self._config = device, rig, config
        self._pictures, self._evidence = pictures, evidence
        self._coarse = rig.scaled(1 / CELL)
        self._cameras = device.to_device(self._coarse.packed(), "the cameras")
        self._odds = device.to_device(location_odds(config), "the odds of foreground")
        self._extents = device.empty((len(rig), 2), np.float32, "the footprints")
        self._geometry = device.empty(4, np.float32, "the grid's position")
        views, rows, columns = prior.location.shape
        border = 2 * config.appearance.reach
        marked = (views, rows + border, columns + border)
        self.near = device.zeros((views, rows, columns), np.uint8, "the location prior")
        # With a border, cleared at the end of every frame.
        self._marks = device.zeros(marked, np.uint8, "the location prior")
        self._counts = device.zeros(BINS**3 + 1, np.int32, "the colour histogram")
        self._memory = device.zeros(BINS**3 + 1, np.float32, "the colour histogram")
        self._surface: Array | None = None
        self._position: tuple[float, ...] = ()
        self._launches: list[Launch] = []

    def learn(self, voxels: SurfaceVoxels) -> None:
        """Enqueue the fit to the voxels that were made of the pictures on the device."""
        if voxels.surface is not self._surface:
            self._attach(voxels)
        grid = voxels.grid
        position = (*grid.origin, grid.voxel_size)
        if position != self._position:
            self._position = position
            self._geometry.set(np.array(position, np.float32))
            self._extents.set(voxel_footprints(self._coarse, grid.voxel_size).astype(np.float32))
        for launch in self._launches:
            launch()

    def forget_location(self) -> None:
        """Clear the location prior; the colours are kept."""
        self.prior.location.fill(0)

    def restart(self) -> None:
        """Clear the whole model."""
        for array in (*self.prior, self.near, self._marks, self._counts, self._memory):
            array.fill(0)

    def _attach(self, voxels: SurfaceVoxels) -> None:
        # No reference to the voxels: they refer to the silhouettes, and a reference cycle would
        # keep all their memory.
        self._surface, device = voxels.surface, self._device
        views, rows, columns = self.prior.location.shape
        picture = self._rig.picture
        defines = self._defines() | size_defines(device, picture, voxels.grid.shape)
        most = max_samples(self._rig, self._config.appearance)

        def launch(
            name: str, size: tuple[int, ...], local: tuple[int, ...], **arguments: Argument
        ) -> Launch:
            kernel = device.kernel("reconstruction/appearance", name, **defines)
            return device.launch(kernel, size, local, **arguments)

        seen = {"n_surface": voxels.count, "marks": self._marks}
        self._launches = [
            launch(
                "mark",
                (16384 if device.is_gpu else 512, views),
                (64, 1),
                picture=picture,
                grid=voxels.grid.shape,
                **seen,
                cameras=self._cameras,
                extents=self._extents,
                geometry=self._geometry,
                indices=voxels.surface,
            ),
            launch(
                "observe",
                (columns, rows, views),
                row_group(device),
                picture=picture,
                **seen,
                odds=self._odds,
                images=self._pictures,
                evidence=self._evidence,
                location=self.prior.location,
                near=self.near,
                counts=self._counts,
            ),
            launch(
                "fade", (BINS**3 + 1,), (64,), counts=self._counts, memory=self._memory, most=most
            ),
            launch(
                "colour_table",
                (BINS**3 // int(defines["ROW"]),),
                (64,),
                counts=self._counts,
                memory=self._memory,
                table=self.prior.colours,
                n_marks=self._marks.size,
                marks=self._marks,
            ),
        ]

    def _defines(self) -> dict[str, int | float]:
        config = self._config.appearance
        return {
            **self._rig.defines,
            **{"CELL": CELL, "BINS": BINS, "REACH": config.reach},
            "ROW": 1 if self._device.is_gpu else BINS,
            "MIN_SURFACE": config.min_surface,
            **{"KEEP": float(config.keep), "UNIFORM": float(config.uniform)},
            "PRIOR": float(config.prior_samples),
            "STEPS": float(self._config.evidence.ratio_steps),
        }


def location_odds(config: SilhouetteConfig) -> np.ndarray:
    """Return the location prior's log odds, int8 counts, indexed by the number of cells within
    `reach` that show the person."""
    appearance, evidence = config.appearance, config.evidence
    share = np.linspace(0, 1, (2 * appearance.reach + 1) ** 2 + 1)
    low, high = appearance.location_outside, appearance.location_inside
    inside, prior = low + share * (high - low), evidence.foreground_prior
    nats = np.log(inside / (1 - inside)) - np.log(prior / (1 - prior))
    return np.rint(np.clip(evidence.ratio_steps * nats, -127, 127)).astype(np.int8)


def max_samples(rig: CameraRig, config: AppearanceConfig) -> int:
    """Return the greatest number of foreground cells, over all views, with which a frame is used
    for the fit."""
    rows, columns = cells(rig)
    return int(config.most * len(rig) * rows * columns)


def looks_again(first: bool, new: bool, config: AppearanceConfig) -> int:
    """Return how often a frame is worked on again: the very `first` one, one that is `new` since it
    does not follow another, or any other."""
    if first:
        return config.first_looks
    return int(new and config.look_again)


def follows(before: int, index: int, config: AppearanceConfig) -> bool:
    """Return whether the frames `before` and `index` are at most `max_gap` apart."""
    return abs(index - before) <= config.max_gap
