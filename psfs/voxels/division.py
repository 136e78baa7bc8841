"""Division of a frame among several people: whose foreground a pixel shows, with probabilities, and
each person's voxels."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cl import Array, Device, InputError
from cl.workgroups import pack_defines, size_defines
from psfs.background.config import UNKNOWN, EvidenceConfig
from psfs.cameras.camera import CameraRig
from psfs.voxels.bricks import Bricks
from psfs.voxels.config import ReconstructionConfig
from psfs.voxels.device_voxels import CarvedVoxels, Voxels
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.sparse import SparseSurface

#: Standard deviation, m, of a person's surface about the spheres that say where the person is, and
#: depth by which somebody must be nearer to the camera to hide another: half an edge of the coarse
#: voxels in which people are followed, and about what a body that is tracked moves aside.
SURFACE_STD = 0.04
#: Distance, m, from all people at which foreground is as likely nobody's.
REACH = 0.35
#: Nats that speak against who is behind another one, if nothing else says who is seen, and beside
#: colours: little, since coarse voxels are also where nobody is.
BEHIND, BEHIND_COLOURED = 2.0, 0.25
#: Levels of each channel of a colour, and bands of a person's height that differ in colours; share
#: of pixels whose colour is not that of the clothes.
LEVELS, BANDS, STRANGE = 8, 3, 0.03


class Division:
    """Division of the latest frame of `voxels` among people, one for each of `grids`.

    spheres: (P, K, 4) float32, to be written before each call: centres and radii, m, of `n_spheres`
    spheres about where each person's body is; a radius of 0 is none. A pixel of the foreground
    shows a person with a probability that falls with the distance of its ray from the person's
    spheres, beside that of the others and of nobody; it is unknown to those that stand behind
    another one there. Each person's voxels are carved from the evidence that this leaves, see
    `psfs.reference.division`. persons: the voxels of each.
    """

    def __init__(
        self,
        device: Device,
        rig: CameraRig,
        voxels: CarvedVoxels,
        grids: Sequence[VoxelGrid],
        n_spheres: int,
        config: ReconstructionConfig | None = None,
        colours: np.ndarray | None = None,
    ) -> None:
        if voxels.evidence is None:
            raise InputError("the voxels have no evidence maps; expected those of a reconstructor")
        config = hide_others(config or ReconstructionConfig())
        n_people, evidence = len(grids), config.silhouette.evidence
        self.spheres = device.zeros((n_people, n_spheres, 4), np.float32, "the people's spheres")
        self.bands: Array | None = None
        self._voxels, table = voxels, None
        if colours is not None:
            self.bands = device.zeros((n_people, n_spheres), np.uint8)
            table = device.to_device(weigh_colours(colours).astype(np.float32), "people's colours")
        shape, align = voxels.evidence.shape, max(1, device.handle.mem_base_addr_align // 8)
        step = -(-math.prod(shape) // align) * align
        maps = device.zeros((n_people * step,), np.int8, "the maps of several people")

        self.persons: list[Voxels] = []
        self._carve: list[SparseSurface] = []
        for person, grid in enumerate(grids):
            part = maps.region(person * step, shape, np.int8)
            surface = SparseSurface(
                Bricks(device, rig, grid, part, evidence.step, config.occupancy)
            )
            self._carve.append(surface)
            self.persons.append(
                Voxels(device, rig, grid, part, surface, lambda _: voxels.pictures())
            )
        defines: dict[str, int] = {
            **{"PEOPLE": n_people, "UNKNOWN": UNKNOWN, **rig.defines},
            **{"COLOURS": int(table is not None), "LEVELS": LEVELS, "BANDS": BANDS},
            **size_defines(device, rig.picture),
            **pack_defines(device, 64),
        }
        project, divide = (
            device.kernel("reconstruction/people", name, **defines)
            for name in ("project_people", "divide_evidence")
        )
        images = {
            "seen": device.empty((len(rig), n_people * n_spheres, 4), np.float32, "images"),
            "boxes": device.empty((len(rig), n_people, 4), np.float32, "images' boxes"),
        }
        packs = -(-rig.width * rig.height // defines["PACK"])
        self._project = device.launch(
                project, (n_people, len(rig)), (1, 1),
                n_spheres=n_spheres, n_views=len(rig), reach=REACH, spheres=self.spheres,
                cameras=device.to_device(rig.packed(), "the cameras"), **images,
            )  # fmt: skip
        self._divide = device.launch(
                divide, (packs, len(rig)), (64, 1),
                picture=rig.picture, n_spheres=n_spheres,
                model=_pack_model(evidence, table is not None),
                precision=0.5 / SURFACE_STD**2, reach=REACH**2, before=SURFACE_STD,
                step=step, spheres=self.spheres, evidence=voxels.evidence,
                parts=maps, pictures=None, bands=self.bands, colours=table, **images,
            )  # fmt: skip

    def __call__(self, person: int | None = None) -> list[Voxels]:
        """Enqueue the division of the latest frame, and the carving of everybody, or of one
        `person` by number; return each person's voxels."""
        self._project()
        if self.bands is not None:
            self._divide.set(pictures=self._voxels.pictures())
        self._divide()
        for carve in self._carve if person is None else (self._carve[person],):
            carve()
        return self.persons


def hide_others(config: ReconstructionConfig) -> ReconstructionConfig:
    """Return the settings for one of several people: what others hide may be occupied, however few
    cameras see it."""
    return config.replace(occupancy=config.occupancy.replace(min_cameras=1))


def _pack_model(evidence: EvidenceConfig, coloured: bool) -> tuple[float, ...]:
    behind = BEHIND_COLOURED if coloured else BEHIND
    return evidence.step, evidence.occlusion_prior, evidence.clamp, behind


def weigh_colours(colours: np.ndarray) -> np.ndarray:
    """Return the log likelihoods (P + 1, BANDS, LEVELS^3) of the colours of people, of whom
    histograms (P, BANDS, LEVELS^3) are known, and of nobody, who has any."""
    number = colours.shape[-1]
    sums = colours.sum(-1, keepdims=True)
    known = np.divide(colours, sums, out=np.full(colours.shape, 1 / number), where=sums > 0)
    shares = (1 - STRANGE) * known + STRANGE / number
    return np.log(np.concatenate([shares, np.full((1, *colours.shape[1:]), 1 / number)]))


def find_bands(spheres: np.ndarray) -> np.ndarray:
    """Return the bands (P, K) uint8 of the height of each of the people's `spheres` (P, K, 4); none
    of them where the radius is 0."""
    bands = np.zeros(spheres.shape[:2], np.uint8)
    for person, row in zip(spheres, bands, strict=True):
        shown = person[:, 3] > 0
        if shown.any():
            row[shown] = divide_height(person[shown, 2])
    return bands


def divide_height(heights: np.ndarray) -> np.ndarray:
    """Return the bands (N,) int of the height that points of one person are in."""
    low, high = heights.min(), heights.max() + 1e-6
    return ((heights - low) / (high - low) * BANDS).astype(int)
