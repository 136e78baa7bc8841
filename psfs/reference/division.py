"""The NumPy twin of `psfs.voxels.division.Division`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from psfs.background.config import UNKNOWN, EvidenceConfig
from psfs.cameras.camera import CameraRig
from psfs.common.colours import colour_bins
from psfs.reference.reconstructor import NumpyReconstructor, carve_voxels
from psfs.voxels.division import (
    BEHIND,
    BEHIND_COLOURED,
    LEVELS,
    REACH,
    SURFACE_STD,
    find_bands,
    hide_others,
    weigh_colours,
)
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.host_voxels import HostVoxels


class NumpyDivision:
    """The voxels of several people in the latest frame of a reconstructor, see
    `psfs.backend.make_division`."""

    def __init__(
        self,
        reconstructor: NumpyReconstructor,
        grids: Sequence[VoxelGrid],
        colours: np.ndarray | None = None,
    ) -> None:
        self._reconstructor, self._grids = reconstructor, grids
        self._colours = None if colours is None else weigh_colours(colours)

    def __call__(self, spheres: np.ndarray, person: int | None) -> list[HostVoxels]:
        """Return the voxels of everybody, also if only a `person` is asked for."""
        latest = self._reconstructor
        assert latest.frame is not None
        config = hide_others(latest.config)
        maps = divide_evidence(
            latest.rig, latest.evidence(), spheres, config.silhouette.evidence,
            latest.frame.images, self._colours,
        )  # fmt: skip
        return [
            carve_voxels(latest.rig, grid, latest.frame, part, config)
            for grid, part in zip(self._grids, maps, strict=True)
        ]


def divide_evidence(
    rig: CameraRig,
    evidence: np.ndarray,
    spheres: np.ndarray,
    config: EvidenceConfig,
    pictures: np.ndarray | None = None,
    colours: np.ndarray | None = None,
) -> np.ndarray:
    """Return each person's evidence (P, V, H, W) int8, of everybody's (V, H, W).

    spheres: (P, K, 4) centres and radii, m, of each person; none where the radius is 0. pictures:
    (V, H, W, 3) uint8, with the log likelihoods `colours` (P + 1, BANDS, LEVELS^3), see
    `weigh_colours`. The ray of a pixel is at a distance d_p from person p, that of the tangent to
    the nearest sphere. A pixel of the foreground shows p with a probability in proportion to

        exp(-d_p^2 / 2 s^2) P(colour | p) exp(-BEHIND [p is behind another one])

    with s = `SURFACE_STD`; and nobody as if at the distance `REACH`. It is multiplied by the
    likelihood of the silhouette, Song et al. eq. (5). The pixel is `UNKNOWN` to those behind others
    who are likelier. What is not foreground stays as it is for all.
    """
    height, width = evidence.shape[1:]
    n_people = len(spheres)
    parts = np.zeros((n_people, *evidence.shape), np.int8)
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(float)
    bands = find_bands(spheres)
    precision = 0.5 / SURFACE_STD**2
    for view, (camera, counts) in enumerate(zip(rig, evidence, strict=True)):
        gaps, depths = (np.full((n_people, height, width), np.inf) for _ in range(2))
        band = np.zeros(gaps.shape, int)
        for person, each in enumerate(spheres):
            images, depth = camera.project(each[:, :3])
            nearest = np.full((height, width), np.inf)
            for k, (image, away, radius) in enumerate(zip(images, depth, each[:, 3], strict=True)):
                if not (away > 0 and radius > 0):
                    continue
                tangent = (((pixels - image) * away / camera.K[0, 0]) ** 2).sum(-1) - radius**2
                band[person][tangent < nearest] = bands[person, k]
                nearest = np.minimum(nearest, tangent)
                front = np.where(tangent <= 0, away, np.inf)
                depths[person] = np.minimum(depths[person], front)
            gaps[person] = np.maximum(nearest, 0)
        nats = np.append(-precision * gaps, np.full((1, height, width), -precision * REACH**2), 0)
        behind = BEHIND
        if pictures is not None and colours is not None:
            behind = BEHIND_COLOURED
            codes = colour_bins(pictures[view], LEVELS)
            for person in range(n_people):
                nats[person] += colours[person][band[person], codes]
            nats[-1] += colours[-1, 0, 0]
        nearer = np.isfinite(depths)[:, None] & (depths < depths[:, None] - SURFACE_STD)
        nats[:-1] -= behind * nearer.any(1)
        shares = np.exp(nats - nats.max(0))
        shares /= shares.sum(0)
        hidden = (nearer * shares[:-1]).sum(1) > shares[:-1]
        divided = config.counts(shares[:-1] * config.likelihood(counts))
        divided = np.where(nearer.any(1) & hidden, UNKNOWN, divided)
        parts[:, view] = np.where(counts > 0, divided, counts)
    return parts
