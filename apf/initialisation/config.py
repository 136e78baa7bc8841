"""Settings of the automatic start, by stage."""

from __future__ import annotations

from functools import partial
from typing import ClassVar

from pydantic import Field

from apf.filters.config import FilterConfig
from psfs.common.config import Config, fraction, natural, nonnegative, part, positive, setting

#: The source of defaults that name no other source.
TUNED = "tuned"


class FrameChoice(Config):
    """Choice of the frames for a start, and definition of a person in them."""

    SOURCE: ClassVar = TUNED

    n_fitted: int = natural(10, "Number of frames that the body is fitted to.")
    duration: float = positive(
        1.0,
        "Time over which these frames are spread; as long as a stride, so that the legs separate.",
        "a person who stoops for 0.8 s is estimated 1 % too short, and so is one with a high "
        "kick within 1.2 s",
        "s",
    )
    n_between: int = nonnegative(
        1, "Approximate number of frames between two fitted ones, which are only tracked."
    )
    n_searched: int = natural(
        4, "Number of fitted frames that are searched over all headings, first and last among them."
    )
    min_voxels: int = natural(200, "Fewest surface voxels that can be a person.", unit="voxels")
    min_part: float = fraction(
        0.05,
        "Share of the largest connected part below which another part is debris, unless it is "
        "near.",
    )
    min_near_part: float = fraction(
        0.01,
        "The same share for parts near those that are not debris, such as a head without its neck.",
    )
    near: float = nonnegative(0.15, "Distance on the floor within which a part is near.", unit="m")


class HeadingConfig(Config):
    """Headings to try, and those to pursue."""

    SOURCE: ClassVar = TUNED

    n_headings: int = natural(8, "Number of headings from which the search begins, evenly around.")
    n_kept: int = natural(3, "Number of best headings that are pursued.")
    separation: float = nonnegative(0.8, "Least angle between the pursued headings.", unit="rad")
    max_first_ratio: float = setting(
        1.4,
        "Ratio to the least cost up to which the limbs of a hypothesis are searched; wrong "
        "limbs cost up to a third more.",
        least=1,
    )
    max_cost_ratio: float = setting(
        1.2, "Ratio to the least cost up to which hypotheses are then tracked.", least=1
    )
    backwards_cost: float = nonnegative(
        0.25, "Share by which the cost grows if the person moves backwards, which people seldom do."
    )
    min_way: float = nonnegative(
        0.25,
        "Distance that the person must move over the first frames for `backwards_cost` to apply.",
        unit="m",
    )


class SpreadConfig(Config):
    """Standard deviations, in their first layer, of the searches without a known pose."""

    SOURCE: ClassVar = TUNED

    root_horizontal: float = nonnegative(
        0.08,
        "Standard deviation of the root along x and y around the middle of the voxels.",
        unit="m",
    )
    root_vertical: float = nonnegative(0.06, "Standard deviation of the root along z.", unit="m")
    root_tilt: float = nonnegative(
        0.15, "Standard deviation of the root about x and y: people stand upright.", unit="rad"
    )
    root_heading: float = nonnegative(
        0.35,
        "Standard deviation of the root about z: about half the angle between two headings.",
        unit="rad",
    )
    body_share: float = nonnegative(
        0.2,
        "Standard deviation of another axis, as a share of what its limits span, when the whole "
        "body is searched for.",
    )
    body_max: float = nonnegative(0.6, "Most of that standard deviation.", unit="rad")
    limb_share: float = nonnegative(0.25, "The same share when one limb is searched for.")
    limb_max: float = nonnegative(0.8, "Most of that standard deviation.", unit="rad")

    def root(self, kind: str) -> float:
        """Return the deviation of the root's axis of this kind (`tx` .. `rz`), m or rad."""
        return {
            "tx": self.root_horizontal, "ty": self.root_horizontal, "tz": self.root_vertical,
            "rx": self.root_tilt, "ry": self.root_tilt, "rz": self.root_heading,
        }[kind]  # fmt: skip


class PoseSearchConfig(Config):
    """The searches for a pose in one frame."""

    SOURCE: ClassVar = TUNED

    n_particles_body: int = setting(
        300, "Number of particles of the search for a whole body.", least=2
    )
    n_particles_limb: int = setting(150, "Number of particles of the search for a limb.", least=2)
    n_particles_near: int = setting(100, "Number of particles of the search near a pose.", least=2)
    noise: float = positive(1.0, "Scale of the deviations of `SpreadConfig` in the first layer.")
    noise_decay: float = positive(0.75, "Factor of the noise from layer to layer.")
    near_noise: float = positive(0.1, "Scale of the body's own sigma in the search near a pose.")
    n_limb_starts: int = natural(
        4, "Number of initial poses of a limb's search: the present one, at rest, and random."
    )
    n_size_steps: int = nonnegative(4, "Number of steps of the fit of size and girth to one frame.")
    trunk_low: float = fraction(
        0.5,
        "Share of the height above which the voxels' middle is that of the trunk.",
        "from the hips to the chest (Drillis & Contini 1966)",
    )
    trunk_high: float = fraction(
        0.75,
        "Share of the height below which the voxels' middle is that of the trunk.",
        "from the hips to the chest (Drillis & Contini 1966)",
    )
    part_margin: float = fraction(
        0.1,
        "Share of the height beyond the hips up to which voxels are used for a body without "
        "head or feet.",
        "the belly ends there",
    )


class CostConfig(Config):
    """Cost of a hypothesis: likelihood error times a power of the registration error."""

    SOURCE: ClassVar = TUNED

    registration_exponent: float = setting(
        0.3, "Exponent of the registration error: 1 % of it counts as 0.3 % of likelihood error."
    )
    surface_scale: float = positive(
        0.04, "Distance at which a point is half unexplained (Geman & McClure 1987).", unit="m"
    )
    bend: float = nonnegative(
        0.003, "Unexplained share that counts as much as one joint bent by `bend_range`."
    )
    bend_range: float = positive(
        0.25, "Deviation from rest, as a share of the range of an axis, that `bend` refers to."
    )
    overlap: float = nonnegative(
        0.1,
        "Unexplained share that counts as much as two parts of which one lies inside the other.",
    )

    def combine(self, error: float, registration_error: float) -> float:
        """Return the cost; lower is better."""
        return error * registration_error**self.registration_exponent


class ShapePrior(Config):
    """Standard deviations around the template; of logs of scales unless a unit is named."""

    SOURCE: ClassVar = TUNED

    size: float = positive(
        0.08,
        "Standard deviation of the whole body's size.",
        "statures of adults vary by 4 % within a sex",
    )
    girth: float = positive(0.15, "Standard deviation of all radii beside the size.")
    length: float = positive(0.025, "Standard deviation of a bone's length beside the size.")
    radius: float = positive(0.08, "Standard deviation of a part's radius beside size and girth.")
    stature: float = positive(
        0.005,
        "Standard deviation of a known stature.",
        "about the accuracy with which people state it",
        "m",
    )
    angle: float = positive(
        1.0,
        "Standard deviation of an angle from rest; low, so that it matters only where the "
        "voxels do not determine the pose.",
        unit="rad",
    )


class StandingConfig(Config):
    """The prior that the feet stand on the floor. Silhouettes say little about it: shoes look like
    floor, and shadows like shoes."""

    SOURCE: ClassVar = TUNED

    height: float = setting(0.0, "Height of the floor.", "by definition", "m")
    reach: float = nonnegative(
        0.3,
        "Height of the lowest voxels above the floor below which a person counts as standing "
        "on it; 0 turns this off.",
        "by hand: more than the height of feet and shins that are missing in silhouettes",
        "m",
    )
    below: float = nonnegative(
        0.1,
        "Depth below the floor down to which the lowest voxels may lie, since hulls are "
        "thicker than people.",
        unit="m",
    )
    ankle: float = positive(
        0.012,
        "Standard deviation of the lower ankle from its height when the foot is flat.",
        "by hand",
        "m",
    )
    lifted: float = positive(
        0.1,
        "Height of both feet over the floor at which the prior counts half (Geman & McClure 1987).",
        unit="m",
    )

    def stands(self, lowest: float) -> bool:
        """Return whether a person whose lowest voxels are at z = `lowest` m stands on the floor."""
        return self.reach > 0 and -self.below < lowest - self.height < self.reach


class ShapeFitConfig(Config):
    """The least-squares fit of the body's shape to the clouds of several frames."""

    SOURCE: ClassVar = TUNED

    prior: ShapePrior = part(ShapePrior)
    standing: StandingConfig = part(StandingConfig)
    n_distances: float = positive(
        300.0,
        "Effective number of independent distances of all clouds together. It does not grow "
        "with the number of frames, because the errors of the cones are the same in every "
        "frame.",
    )
    noise: float = positive(0.02, "Standard deviation of one of them.", unit="m")
    stray: float = fraction(0.002, "Share of the points below the feet or above the head.")
    spacing: float = positive(0.06, "Distance between points on the body's surface.", unit="m")
    n_points: int = natural(800, "Number of points of each cloud that are compared.")
    damping: float = nonnegative(
        1e-3, "Share of a pose's own normal matrix added to its diagonal (Levenberg 1944)."
    )
    n_steps: int = natural(6, "Number of Gauss-Newton steps.")
    first_reach: float = positive(
        0.08, "Distance at which a point counts a quarter in the first step.", unit="m"
    )
    last_reach: float = positive(
        0.03,
        "The same distance in the last step; those between are spaced geometrically.",
        unit="m",
    )


class AcceptanceConfig(Config):
    """Conditions for a good start, and thresholds of its warnings."""

    SOURCE: ClassVar = TUNED

    good: float = nonnegative(
        0.3,
        "Registration error above which the start is searched again with other random numbers;"
        " the attempt with the least cost is used, of those that are accepted.",
    )
    n_attempts: int = natural(3, "Number of attempts in all.")
    hopeless: float = nonnegative(0.55, "Registration error above which no body was found.")
    rival: float = setting(
        1.1, "Factor of misfit below which another hypothesis makes a start doubtful.", least=1
    )
    ambiguous: float = setting(
        1.15,
        "Factor of misfit below which another hypothesis is so close that the start is "
        "searched again over more frames.",
        "tuned: a body turned about in a skirt has up to 1.12, one whose legs show 1.23 and more",
        least=1,
    )
    longer: float = setting(
        2.5,
        "Factor by which the time span of that search is longer; it uses twice as many frames.",
        "tuned: over a shorter walk the hull of a skirt may be turned about",
        least=1,
    )
    stout: float = nonnegative(
        3.0,
        "Excess of girth over the template's from which on a start is doubtful, because hardly"
        " any standing person has it.",
        unit="standard deviations of the prior",
    )


class StartConfig(Config):
    """All settings of the automatic start."""

    frames: FrameChoice = part(FrameChoice)
    headings: HeadingConfig = part(HeadingConfig)
    spread: SpreadConfig = part(SpreadConfig)
    search: PoseSearchConfig = part(PoseSearchConfig)
    cost: CostConfig = part(CostConfig)
    shape: ShapeFitConfig = part(ShapeFitConfig)
    acceptance: AcceptanceConfig = part(AcceptanceConfig)
    #: A visual hull of few cameras is thicker than the person, so that a wrongly turned or bent
    #: body fills it as well. Silhouettes and edges therefore have more weight than in tracking.
    filter: FilterConfig = Field(
        default_factory=partial(
            FilterConfig.create,
            surface_weight=1.0,
            silhouette_recall_weight=2.0,
            contour_weight=4.0,
            part_colour_weight=0.0,  # the colours of the parts are not estimated yet
        )
    )
