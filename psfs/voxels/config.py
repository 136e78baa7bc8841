"""Settings of the reconstruction and its voxels, shared by the kernels and their NumPy twins."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

from psfs.common.config import Config, part, setting
from psfs.silhouettes.config import SilhouetteConfig

if TYPE_CHECKING:
    import numpy as np


class OccupancyConfig(Config):
    """The voxels' occupancy (Song et al. eq. 3-9)."""

    prior: float = setting(
        0.5, "Prior probability P(V = 1) that a voxel is occupied.", "even odds", above=0, below=1
    )
    smoothing: Literal["faces", "cube"] = setting(
        "faces",
        "The voxels whose mean probability is a voxel's: itself and its six neighbours, or a cube "
        "of 3x3x3, which wears limbs away.",
        "by true masks: of the hulls' volume the cube at 0.6 lacked 11 %, the faces lack 8 %",
    )
    threshold: float = setting(
        0.65,
        "Smoothed probability above which a voxel is occupied.",
        "tuned with true masks",
        above=0,
        below=1,
    )
    min_cameras: int | None = setting(
        None,
        "Least number of images that a voxel must project into, otherwise it is empty; none: half "
        "of the cameras, but at least three, or all if there are fewer.",
        "the share grows with the rig",
    )
    reach: float | None = setting(
        None,
        "Distance in the pictures up to which evidence reaches, and farther where the calibration "
        "is off; none: 1 where a body is tracked, since the pixels at its outlines are only partly "
        "covered, and carve thin limbs away; 0 for clouds, which would be thicker than the person.",
        "outlines are known to a pixel",
        "px",
        least=0,
    )
    closed_surface: bool = setting(
        True,
        "Whether voxels with an empty neighbour at an edge or corner belong to the surface, whose "
        "projection then has no holes; else only those with an empty neighbour at a face do.",
        "measured with true masks: without them 2 to 4 % of a silhouette are holes",
    )

    def seeing_cameras(self, n_cameras: int) -> int:
        """Return how many of `n_cameras` must see a voxel."""
        from psfs.cameras.rig_geometry import required_cameras

        if self.min_cameras is not None:
            return self.min_cameras
        return required_cameras(n_cameras, 0.5, 3)

    def reach_px(self, blur: float) -> int:
        """Return the reach of evidence, whole px, in pictures whose calibration's error has the
        standard deviation `blur`, px."""
        return round(math.hypot(self.reach or 0.0, blur))

    def probabilities(self, n_cameras: int, step: float) -> np.ndarray:
        """Return the occupancy for every sum of evidence counts from -127 V to 127 V, (254 V + 1,).

        Entry s + 127 V is 1 / (1 + exp(-(logit(prior) + s step))): Song et al. eq. (3).
        """
        import numpy as np

        counts = np.arange(-127 * n_cameras, 127 * n_cameras + 1)
        logit = np.log(self.prior / (1 - self.prior))
        return np.asarray(1 / (1 + np.exp(-(logit + counts * step))))


class ReconstructionConfig(Config):
    """Settings of the reconstruction, shared by the kernels and their NumPy twins."""

    silhouette: SilhouetteConfig = part(SilhouetteConfig)
    occupancy: OccupancyConfig = part(OccupancyConfig)

    def reaching(self, reach: float) -> ReconstructionConfig:
        """Return the settings with this reach of evidence, px, if they state none."""
        if self.occupancy.reach is not None:
            return self
        return self.replace(occupancy=self.occupancy.replace(reach=reach))


#: Edges of voxels, least and greatest, m.
VOXEL_EDGES = (1e-6, 100.0)
#: Parts of a cloud are debris if they have fewer voxels than this share of the largest part's.
DEBRIS_SHARE = 0.05
