"""The connected regions of occupied space in coarse voxels, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from psfs.cameras.camera import CameraRig
from psfs.common.colours import colour_bins
from psfs.voxels.config import ReconstructionConfig
from psfs.voxels.division import BANDS, LEVELS, divide_height
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.occupied_box import CoarseSpace, reachable_box, remove_speckle

#: Edge of a voxel, m, in a room of usual size, and the upper end of the volume, m.
_VOXEL, _CEILING = 0.08, 2.4
#: Volume of silhouettes' hulls below which nothing is followed, m^3, and voxels that are debris.
_LEAST_VOLUME, DEBRIS = 0.03, 8
#: Share of a region's silhouettes, in some camera, that the other regions of the frame do not
#: explain; a region below it is a ghost, with which nobody begins. Of two people before four
#: cameras ghosts have up to 0.18, people from 0.3 on.
_GHOST = 0.25
#: Greatest number of voxels.
_MOST_VOXELS = 1_500_000


@dataclass(frozen=True, eq=False)
class CoarseFrame:
    """The occupied coarse voxels (N,) of one frame, as flat indices, with the `regions` (N,) that
    they belong to, from 0 on; `ghosts`: the regions that nothing fills, as the rest explains their
    silhouettes."""

    index: int
    voxels: np.ndarray
    regions: np.ndarray
    ghosts: frozenset[int] = frozenset()


def count_least_voxels(grid: VoxelGrid) -> int:
    """Return the least number of voxels of what is followed."""
    return max(DEBRIS, round(_LEAST_VOLUME / grid.voxel_size**3))


class CoarseVoxels(CoarseSpace):
    """Coarse voxels within reach of the cameras.

    rig: of the small pictures. stated: the volume, if one is stated.
    """

    def __init__(
        self,
        rig: CameraRig,
        stated: tuple[np.ndarray, np.ndarray] | None,
        reconstruction: ReconstructionConfig,
    ) -> None:
        low, high = stated or reachable_box(rig)
        low, high = np.array(low, float), np.array(high, float)
        high[2] = max(low[2] + _VOXEL, min(high[2], _CEILING))
        finest = float(np.cbrt(np.prod(high - low) / _MOST_VOXELS))
        grid = VoxelGrid.covering(low, high, max(_VOXEL, finest))
        super().__init__(rig, grid, reconstruction.occupancy.seeing_cameras(len(rig)))
        self.rows = np.full(self.grid.size, -1, np.int32)
        self.rows[self.used] = np.arange(len(self.used))

    def __call__(self, index: int, evidence: np.ndarray) -> CoarseFrame:
        """Carve a frame with the evidence maps (V, H, W) int8 of its small pictures."""
        voxels = self.carve(remove_speckle(evidence))
        occupied = np.zeros(self.grid.size, bool)
        occupied[voxels] = True
        labels, _ = scipy.ndimage.label(occupied.reshape(self.grid.shape), np.ones((3, 3, 3)))
        regions = labels.ravel()[voxels] - 1
        return CoarseFrame(index, voxels, regions, self._find_ghosts(evidence, voxels, regions))

    def _find_ghosts(
        self, evidence: np.ndarray, voxels: np.ndarray, regions: np.ndarray
    ) -> frozenset[int]:
        """Return the large regions whose silhouettes the other ones explain; the one that they
        explain best first, which then explains nothing."""
        sizes = np.bincount(regions)
        large = [int(of) for of in np.flatnonzero(sizes >= count_least_voxels(self.grid))]
        found: set[int] = set()
        while len(large) > 1:
            rest = ~np.isin(regions, list(found))
            shares = [
                self.measure_unexplained(
                    evidence, voxels[regions == of], voxels[rest & (regions != of)]
                )
                for of in large
            ]
            if min(shares) >= _GHOST:
                break
            found.add(large.pop(int(np.argmin(shares))))
        return frozenset(found)

    def measure_unexplained(
        self, evidence: np.ndarray, voxels: np.ndarray, others: np.ndarray
    ) -> float:
        """Return the share of the silhouettes of `voxels` (N,) that is foreground and that the
        `others` (M,) do not cover. It is that of the camera where the share is second largest,
        because a shadow can have a large share in one camera."""
        shares = [0.0, 0.0]
        for view in range(len(self.rig)):
            own, rest = (self.cover(view, self.rows[those]) for those in (voxels, others))
            if own.any():
                free = own & ~rest & (evidence[view] > 0)
                shares.append(float(free.sum() / own.sum()))
        return sorted(shares)[-2]

    def measure_colours(
        self, images: np.ndarray, evidence: np.ndarray, parts: list[np.ndarray]
    ) -> list[np.ndarray]:
        """Return for each of `parts`, flat indices of voxels, its colours: a histogram (BANDS,
        LEVELS^3) for each band of height, from the pixels (V, H, W, 3) of the voxels that no other
        voxel hides; zeros where nothing shows."""
        rows = [self.rows[part] for part in parts]
        everything = np.concatenate(rows) if rows else np.zeros(0, int)
        found = [np.zeros((BANDS, LEVELS**3)) for _ in parts]
        bands = [divide_height(self.grid.centres(part)[:, 2]) for part in parts]
        for view in range(len(self.rig)):
            nearest = self._find_nearest(view, everything)
            colours = images[view].reshape(-1, images.shape[-1])
            for part, band, into in zip(rows, bands, found, strict=True):
                at, depth = self.pixels[view, part], self.depths[view, part]
                behind = depth - nearest[self._find_cells(view, at)]
                seen = (at >= 0) & (behind < self.grid.voxel_size)
                seen &= evidence[view].ravel()[at] > 0
                np.add.at(into, (band[seen], colour_bins(colours[at[seen]], LEVELS)), 1)
        return found

    def _find_cells(self, view: int, at: np.ndarray) -> np.ndarray:
        """Return the cells, of about a voxel's width, that flat pixels lie in."""
        width = self.widths[view]
        across = -(-self.rig.width // width)
        return (at // self.rig.width) // width * across + (at % self.rig.width) // width

    def _find_nearest(self, view: int, rows: np.ndarray) -> np.ndarray:
        """Return the least depth of the voxels in each cell."""
        width = self.widths[view]
        n_cells = -(-self.rig.width // width) * -(-self.rig.height // width)
        nearest = np.full(n_cells, np.inf)
        at = self.pixels[view, rows]
        inside = at >= 0
        cells = self._find_cells(view, at[inside])
        np.minimum.at(nearest, cells, self.depths[view, rows][inside])
        return nearest


def measure_similarity(first: np.ndarray, second: np.ndarray) -> float:
    """Return the mean Bhattacharyya coefficient of two histograms (BANDS, LEVELS^3), in half as
    many levels, over the bands that both have; 1 if there is none."""
    first, second = (_halve_levels(of) for of in (first, second))
    sums = first.sum(1), second.sum(1)
    both = (sums[0] > 0) & (sums[1] > 0)
    if not both.any():
        return 1.0
    shares = (first[both] / sums[0][both, None]) * (second[both] / sums[1][both, None])
    return float(np.sqrt(shares).sum(1).mean())


def _halve_levels(colours: np.ndarray) -> np.ndarray:
    bands, half = len(colours), round(np.cbrt(colours.shape[1])) // 2
    pairs = colours.reshape(bands, half, 2, half, 2, half, 2)
    return pairs.sum((2, 4, 6)).reshape(bands, -1)
