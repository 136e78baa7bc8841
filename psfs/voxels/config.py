"""Parameters of the voxels, shared by the kernels and their NumPy twins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from psfs.cameras.rig_geometry import required_cameras
from psfs.common.ranges import check_range


@dataclass(frozen=True)
class OccupancyConfig:
    """Parameters of the voxel occupancy (Song et al. eq. 3-9)."""

    prior: float = 0.5
    """P(V = 1) of a voxel: even odds."""
    threshold: float = 0.6
    """Smoothed probability above which a voxel is occupied; set by hand."""
    min_cameras: int | None = None
    """A voxel within fewer images is empty; None asks for `camera_share` of the cameras."""
    camera_share: float = 0.5
    """Share of the cameras that must see a voxel."""
    least_cameras: int = 3
    """No fewer cameras than these, or all if there are fewer; set by hand."""

    def __post_init__(self) -> None:
        check_range("prior", self.prior, 0, 1)
        check_range("threshold", self.threshold, 0, 1)

    def seeing_cameras(self, n_cameras: int) -> int:
        """Return how many of `n_cameras` must see a voxel."""
        if self.min_cameras is not None:
            return self.min_cameras
        return required_cameras(n_cameras, self.camera_share, self.least_cameras)

    def probabilities(self, n_cameras: int, step: float) -> np.ndarray:
        """Return the occupancy for every sum of evidence counts from -127 V to 127 V, (254 V + 1,).

        Entry s + 127 V is 1 / (1 + exp(-(logit(prior) + s step))): Song et al. eq. (3).
        """
        counts = np.arange(-127 * n_cameras, 127 * n_cameras + 1)
        logit = np.log(self.prior / (1 - self.prior))
        return np.asarray(1 / (1 + np.exp(-(logit + counts * step))))


@dataclass(frozen=True)
class ColourConfig:
    """Parameters of the voxels' colours (Song et al. 3.3)."""

    tolerance: float = 1.5
    """A voxel is visible where it lies at most so many voxels behind the nearest one; set by
    hand: more than the diagonal of a face, 1.41, less than that of a cube, 1.73."""

    def __post_init__(self) -> None:
        check_range("tolerance", self.tolerance, 0)


@dataclass(frozen=True)
class EdgeConfig:
    """Proximity to the edges of the voxels' silhouettes, see `psfs.voxels.reprojection`; set by
    hand."""

    sigma: float = 4.0
    """Standard deviation of the proximity, px in maps `width` px wide."""
    width: int = 640
    """Width of maps, px, that `sigma` is stated for; in others it scales with them."""
    reach: float = 3.0
    """Standard deviations beyond which the proximity is 0: the usual 3 sigma."""


@dataclass(frozen=True)
class ForegroundJoinConfig:
    """What of the pictures' foreground joins the silhouettes of the voxels.

    The values were set by hand and tried as a whole, with the posture prior at half its weight: on
    six sequences in other rooms (4 to 8 cameras, two seeds, from the true start) the mean error
    fell from 51 to 39 mm in the prototype, mostly arms.
    """

    on: bool = True
    """Whether any joins; Song et al. look at the voxels alone."""
    sides: int = 35
    """Percent of the silhouette's height by which the box around it is larger at both sides and
    above: an arm that was carved away reaches that far."""
    below: int = 5
    """The same below it, where shadows lie."""
    least_pixels: int = 40
    """Foreground pixels among 24 x 24 that are no speckle."""

    def __post_init__(self) -> None:
        check_range("sides", self.sides, 0, 1000, ends=True)
        check_range("below", self.below, 0, 1000, ends=True)
        check_range("least_pixels", self.least_pixels, 1, 576, ends=True)


@dataclass(frozen=True)
class VolumeConfig:
    """How the volume is found when nobody states one, see `psfs.volume`.

    The defaults were set by hand; the tests hold them on dancers, a dinosaur and synthetic bodies.
    """

    samples: int = 8
    """Frames spread over the selection that are looked at."""
    coarse: int = 64
    """Voxels along the longest side of the volume, in the coarse search."""
    margin: float = 0.06
    """Share of the box found that is added to each side of it..."""
    margin_voxels: float = 1.5
    """...and at least so many coarse voxels."""
    fine: int = 150
    """Voxels along the longest side, by default, for things."""
    finest: int = 400
    """Voxels along the longest side, at most, for people."""
    people_distance: float = 1.5
    """Rigs whose cameras stand at least this far away, m, film people."""
    people_voxel: float = 0.02
    """Edge of a voxel for people, m."""
    floor: float = -0.1
    """Rigs that film people stand on the floor: nothing is looked for below this height, m..."""
    floor_depth: float = 0.25
    """...unless what is seen reaches so much further down, m (people: up to 0.1)..."""
    head_room: float = 1.0
    """...and if so much room, m, is left above it."""
