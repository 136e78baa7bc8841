"""Settings of the reconstruction and its voxels, shared by the kernels and their NumPy twins."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

from psfs.common.config import Config, fraction, natural, nonnegative, part, positive, setting
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
        "tuned on synthetic people with true masks",
        above=0,
        below=1,
    )
    min_cameras: int | None = setting(
        None,
        "Least number of images that a voxel must project into, otherwise it is empty; none: "
        "`camera_share` of the cameras.",
        "the share grows with the rig",
    )
    camera_share: float = fraction(0.5, "Share of the cameras that must see a voxel.", "by hand")
    least_cameras: int = nonnegative(
        3,
        "Least number of cameras that `camera_share` asks for, or all if there are fewer.",
        "by hand",
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
        return required_cameras(n_cameras, self.camera_share, self.least_cameras)

    def probabilities(self, n_cameras: int, step: float) -> np.ndarray:
        """Return the occupancy for every sum of evidence counts from -127 V to 127 V, (254 V + 1,).

        Entry s + 127 V is 1 / (1 + exp(-(logit(prior) + s step))): Song et al. eq. (3).
        """
        import numpy as np

        counts = np.arange(-127 * n_cameras, 127 * n_cameras + 1)
        logit = np.log(self.prior / (1 - self.prior))
        return np.asarray(1 / (1 + np.exp(-(logit + counts * step))))


class BodyPriorConfig(Config):
    """A tracked body as a prior, see `psfs reconstruct --track`: of the silhouettes, as long as the
    person's appearance is estimated, with the colours of each part; else, as with ready masks, of
    the voxels' occupancy. The log odds fall linearly between their bounds."""

    SOURCE: ClassVar = "tried on synthetic people with true masks: docs/lab/accuracy.md"

    inside: float = nonnegative(
        5.0, "Log odds that a voxel in the body's cones is occupied.", unit="nats"
    )
    outside: float = setting(
        -2.0,
        "Log odds that a voxel outside of them is; 0 in a frame in which a limb is lost.",
        unit="nats",
        most=0,
    )
    depth: float = positive(
        0.02, "Depth below the cones' surface from which a voxel is inside.", unit="m"
    )
    distance: float = positive(
        0.02, "Distance from their surface beyond which it is outside.", unit="m"
    )
    foreground: float = nonnegative(
        5.0,
        "Log odds that a pixel well within the drawn body shows the person, in place of "
        "`location_inside` of the silhouettes.",
        unit="nats",
    )
    background: float = setting(
        -1.2,
        "Log odds that a pixel well beside it does; 0 in a frame in which a limb is lost.",
        unit="nats",
        most=0,
    )
    width: float = positive(
        0.01,
        "Distance at the drawn body's edge over which these fall by 1 nat; they are 0 at the edge.",
        unit="m",
    )
    low_width: float = positive(
        0.0035, "The same within parts below `low`, whose shadows look like shoes.", unit="m"
    )
    low: float = setting(
        0.2, "Height above the floor below which a part lies that stands on it.", unit="m"
    )
    colour_reach: float = nonnegative(
        0.1,
        "Distance from the drawn body up to which pixels are compared with the colours of its "
        "nearest part instead of those of the whole person.",
        unit="m",
    )
    samples: int = natural(
        5, "Number of frames in which the track is compared with the silhouettes."
    )
    least_agreement: float = fraction(
        0.4,
        "Least share of the body's axes that lies on silhouettes; below it, the track is of "
        "another take.",
        "by hand",
    )


class ColourConfig(Config):
    """The voxels' colours (Song et al. 3.3)."""

    tolerance: float = positive(
        1.5,
        "Distance behind the nearest voxel up to which a voxel is visible.",
        "by hand: more than the diagonal of a voxel's face, 1.41, less than that of the cube, 1.73",
        "voxels",
    )


class EdgeConfig(Config):
    """The proximity to the edges of the voxels' silhouettes, see `psfs.voxels.reprojection`."""

    SOURCE: ClassVar = "by hand"

    sigma: float = positive(
        4.0, "Standard deviation of the proximity in maps `width` px wide.", unit="px"
    )
    width: int = natural(
        640, "Width of maps that `sigma` is stated for; in others it scales.", unit="px"
    )
    reach: float = positive(
        3.0,
        "Distance from an edge beyond which the proximity is 0.",
        "the usual 3 sigma",
        "standard deviations",
    )


class ForegroundJoinConfig(Config):
    """Settings of the pictures' foreground that joins the silhouettes of the voxels."""

    SOURCE: ClassVar = (
        "by hand; tried as a whole, with the posture prior at half its weight, on six sequences in "
        "other rooms (4 to 8 cameras, two seeds, from the true start): the mean error fell from 51 "
        "to 39 mm in the prototype, mostly of arms"
    )

    on: bool = setting(
        True,
        "Whether to join the pictures' foreground to the silhouettes; Song et al. use the "
        "voxels alone.",
    )
    sides: int = setting(
        35,
        "Enlargement of the box around the silhouette at both sides and above, as a share of "
        "the silhouette's height: as far as a missing arm reaches.",
        unit="%",
        least=0,
        most=1000,
    )
    below: int = setting(
        5,
        "Enlargement of the same box below, as a share of the silhouette's height; smaller, "
        "because of shadows.",
        unit="%",
        least=0,
        most=1000,
    )
    least_pixels: int = setting(
        40,
        "Least number of foreground pixels among 24 x 24 that do not count as speckle.",
        unit="px",
        least=1,
        most=576,
    )


class VolumeConfig(Config):
    """Settings of the search for the volume if none is stated, see `psfs.volume`."""

    SOURCE: ClassVar = "by hand; the tests hold it on dancers, a dinosaur and synthetic bodies"

    samples: int = natural(8, "Number of examined frames, spread over the selection.")
    coarse: int = setting(
        64,
        "Number of voxels along the longest side of the volume in the coarse search.",
        least=1,
        most=10_000,
    )
    margin: float = nonnegative(0.06, "Margin on each side of the box, as a share of the box.")
    margin_voxels: float = nonnegative(
        1.5, "Least margin on each side of the box.", unit="coarse voxels"
    )
    fine: int = setting(
        150,
        "Number of voxels along the longest side for objects, if no voxel size is stated.",
        least=1,
        most=10_000,
    )
    finest: int = setting(
        400, "Greatest number of voxels along the longest side for people.", least=1, most=10_000
    )
    people_distance: float = nonnegative(
        1.5, "Least distance of the cameras from the middle for a rig that films people.", unit="m"
    )
    people_voxel: float = positive(0.02, "Edge of a voxel for people.", unit="m")
    floor: float = setting(
        -0.1,
        "Height below which the search ignores everything, for rigs that film people.",
        unit="m",
    )
    floor_depth: float = nonnegative(
        0.25,
        "Depth below `floor` beyond which visible parts count nevertheless (people reach 0.1 m).",
        unit="m",
    )
    head_room: float = setting(
        1.0, "Least height of the box above the floor for `floor` to apply.", unit="m"
    )


class ReconstructionConfig(Config):
    """Settings of the reconstruction, shared by the kernels and their NumPy twins."""

    silhouette: SilhouetteConfig = part(SilhouetteConfig)
    occupancy: OccupancyConfig = part(OccupancyConfig)
    body: BodyPriorConfig = part(BodyPriorConfig)
    colour: ColourConfig = part(ColourConfig)
    volume: VolumeConfig = part(VolumeConfig)


class DivisionConfig(Config):
    """Division of voxels and foreground among people whose bodies are tracked."""

    SOURCE: ClassVar = "by hand, as `psfs.people.separation` does"

    reach: float = positive(
        0.35, "Distance from a body up to which voxels are the person's.", unit="m"
    )
    beside: float = positive(
        0.35, "Distance from a body's image up to which foreground may be the person's.", unit="m"
    )
    before: float = nonnegative(
        0.05,
        "Depth by which another person must be nearer to the camera to hide this one.",
        unit="m",
    )
