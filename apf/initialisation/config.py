"""Settings of the automatic start, by stage."""

from __future__ import annotations

from functools import partial
from typing import ClassVar

from pydantic import Field

from apf.filters.config import FilterConfig
from apf.initialisation.frame_config import TUNED as TUNED
from apf.initialisation.frame_config import FrameChoice as FrameChoice
from psfs.common.config import Config, part, setting


class HeadingConfig(Config):
    """Headings to try, and those to pursue."""

    SOURCE: ClassVar = TUNED

    n_headings: int = setting(
        8, "Number of headings from which the search begins, evenly around.", least=1
    )
    n_kept: int = setting(3, "Number of best headings that are pursued.", least=1)
    separation: float = setting(
        0.8, "Least angle between the pursued headings.", unit="rad", least=0
    )
    max_first_ratio: float = setting(
        1.4,
        "Ratio to the least cost up to which the limbs of a hypothesis are searched; wrong "
        "limbs cost up to a third more.",
        least=1,
    )
    max_cost_ratio: float = setting(
        1.2, "Ratio to the least cost up to which hypotheses are then tracked.", least=1
    )
    backwards_cost: float = setting(
        0.25,
        "Share by which the cost grows if the person moves backwards, which people seldom do.",
        least=0,
    )
    min_way: float = setting(
        0.25,
        "Distance that the person must move over the first frames for `backwards_cost` to apply.",
        unit="m",
        least=0,
    )


class SpreadConfig(Config):
    """Standard deviations, in their first layer, of the searches without a known pose."""

    SOURCE: ClassVar = TUNED

    root_horizontal: float = setting(
        0.08,
        "Standard deviation of the root along x and y around the middle of the voxels.",
        unit="m",
        least=0,
    )
    root_vertical: float = setting(
        0.06, "Standard deviation of the root along z.", unit="m", least=0
    )
    root_tilt: float = setting(
        0.15,
        "Standard deviation of the root about x and y: people stand upright.",
        unit="rad",
        least=0,
    )
    root_heading: float = setting(
        0.35,
        "Standard deviation of the root about z: about half the angle between two headings.",
        unit="rad",
        least=0,
    )
    body_share: float = setting(
        0.2,
        "Standard deviation of another axis, as a share of what its limits span, when the whole "
        "body is searched for.",
        least=0,
    )
    body_max: float = setting(0.6, "Most of that standard deviation.", unit="rad", least=0)
    limb_share: float = setting(0.25, "The same share when one limb is searched for.", least=0)
    limb_max: float = setting(0.8, "Most of that standard deviation.", unit="rad", least=0)

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
    noise: float = setting(
        1.0, "Scale of the deviations of `SpreadConfig` in the first layer.", above=0
    )
    noise_decay: float = setting(0.75, "Factor of the noise from layer to layer.", above=0)
    near_noise: float = setting(
        0.1, "Scale of the body's own sigma in the search near a pose.", above=0
    )
    n_limb_starts: int = setting(
        4,
        "Number of initial poses of a limb's search: the present one, at rest, and random.",
        least=1,
    )
    n_size_steps: int = setting(
        4, "Number of steps of the fit of size and girth to one frame.", least=0
    )
    trunk_low: float = setting(
        0.5,
        "Share of the height above which the voxels' middle is that of the trunk.",
        "from the hips to the chest (Drillis & Contini 1966)",
        least=0,
        most=1,
    )
    trunk_high: float = setting(
        0.75,
        "Share of the height below which the voxels' middle is that of the trunk.",
        "from the hips to the chest (Drillis & Contini 1966)",
        least=0,
        most=1,
    )
    part_margin: float = setting(
        0.1,
        "Share of the height beyond the hips up to which voxels are used for a body without "
        "head or feet.",
        "the belly ends there",
        least=0,
        most=1,
    )


class CostConfig(Config):
    """Cost of a hypothesis: likelihood error times a power of the registration error."""

    SOURCE: ClassVar = TUNED

    registration_exponent: float = setting(
        0.3, "Exponent of the registration error: 1 % of it counts as 0.3 % of likelihood error."
    )
    surface_scale: float = setting(
        0.04,
        "Distance at which a point is half unexplained (Geman & McClure 1987).",
        unit="m",
        above=0,
    )
    bend: float = setting(
        0.003, "Unexplained share that counts as much as one joint bent by `bend_range`.", least=0
    )
    bend_range: float = setting(
        0.25,
        "Deviation from rest, as a share of the range of an axis, that `bend` refers to.",
        above=0,
    )
    overlap: float = setting(
        0.1,
        "Unexplained share that counts as much as two parts of which one lies inside the other.",
        least=0,
    )

    def combine(self, error: float, registration_error: float) -> float:
        """Return the cost; lower is better."""
        return error * registration_error**self.registration_exponent


class ShapePrior(Config):
    """Standard deviations around the template; of logs of scales unless a unit is named."""

    SOURCE: ClassVar = TUNED

    size: float = setting(
        0.08,
        "Standard deviation of the whole body's size.",
        "statures of adults vary by 4 % within a sex",
        above=0,
    )
    girth: float = setting(0.15, "Standard deviation of all radii beside the size.", above=0)
    length: float = setting(
        0.025, "Standard deviation of a bone's length beside the size.", above=0
    )
    radius: float = setting(
        0.08, "Standard deviation of a part's radius beside size and girth.", above=0
    )
    loose: float = setting(
        3.0,
        "Excess of a part's radius over that of the other parts, from which on it is clothes that "
        "hang from the body.",
        "thighs of `hard_skirt_4cam`: 3.3 to 5.5; in six other sequences at most 2.5",
        unit="standard deviations of `radius`",
        above=0,
    )
    clothes: float = setting(
        0.5,
        "Standard deviation of such a part's radius, which then says nothing about the others.",
        "by hand",
        above=0,
    )
    stature: float = setting(
        0.005,
        "Standard deviation of a known stature.",
        "about the accuracy with which people state it",
        "m",
        above=0,
    )
    angle: float = setting(
        1.0,
        "Standard deviation of an angle from rest; low, so that it matters only where the "
        "voxels do not determine the pose.",
        unit="rad",
        above=0,
    )


class StandingConfig(Config):
    """The prior that the feet stand on the floor. Silhouettes say little about it: shoes look like
    floor, and shadows like shoes."""

    SOURCE: ClassVar = TUNED

    height: float = setting(0.0, "Height of the floor.", "by definition", "m")
    reach: float = setting(
        0.3,
        "Height of the lowest voxels above the floor below which a person counts as standing "
        "on it; 0 turns this off.",
        "by hand: more than the height of feet and shins that are missing in silhouettes",
        "m",
        least=0,
    )
    below: float = setting(
        0.1,
        "Depth below the floor down to which the lowest voxels may lie, since hulls are "
        "thicker than people.",
        unit="m",
        least=0,
    )
    ankle: float = setting(
        0.012,
        "Standard deviation of the lower ankle from its height when the foot is flat.",
        "by hand",
        "m",
        above=0,
    )
    lifted: float = setting(
        0.1,
        "Height of both feet over the floor at which the prior counts half (Geman & McClure 1987).",
        unit="m",
        above=0,
    )

    def stands(self, lowest: float) -> bool:
        """Return whether a person whose lowest voxels are at z = `lowest` m stands on the floor."""
        return self.reach > 0 and -self.below < lowest - self.height < self.reach


class ShapeFitConfig(Config):
    """The least-squares fit of the body's shape to the clouds of several frames."""

    SOURCE: ClassVar = TUNED

    prior: ShapePrior = part(ShapePrior, "The prior on people's shapes.")
    standing: StandingConfig = part(StandingConfig, "The prior on their feet.")
    n_distances: float = setting(
        300.0,
        "Effective number of independent distances of all clouds together. It does not grow "
        "with the number of frames, because the errors of the cones are the same in every "
        "frame.",
        above=0,
    )
    noise: float = setting(0.02, "Standard deviation of one of them.", unit="m", above=0)
    stray: float = setting(
        0.002, "Share of the points below the feet or above the head.", least=0, most=1
    )
    spacing: float = setting(
        0.06, "Distance between points on the body's surface.", unit="m", above=0
    )
    n_points: int = setting(800, "Number of points of each cloud that are compared.", least=1)
    damping: float = setting(
        1e-3, "Share of a pose's own normal matrix added to its diagonal (Levenberg 1944).", least=0
    )
    n_steps: int = setting(6, "Number of Gauss-Newton steps.", least=1)
    first_reach: float = setting(
        0.08, "Distance at which a point counts a quarter in the first step.", unit="m", above=0
    )
    last_reach: float = setting(
        0.03,
        "The same distance in the last step; those between are spaced geometrically.",
        unit="m",
        above=0,
    )


class AcceptanceConfig(Config):
    """Conditions for a good start, and thresholds of its warnings."""

    SOURCE: ClassVar = TUNED

    good: float = setting(
        0.3,
        "Registration error above which the start is searched again with other random numbers;"
        " the attempt with the least cost is used.",
        least=0,
    )
    n_attempts: int = setting(3, "Number of attempts in all.", least=1)
    hopeless: float = setting(0.55, "Registration error above which no body was found.", least=0)
    rival: float = setting(
        1.1, "Factor of misfit below which another hypothesis makes a start doubtful.", least=1
    )
    ambiguous: float = setting(
        1.15,
        "Factor of misfit below which another hypothesis is so close that the start is "
        "searched again over more frames.",
        "`hard_skirt_4cam`: 1.0 to 1.12, one start in five turned about; laboratory sequences: "
        "1.23 and more",
        least=1,
    )
    longer: float = setting(
        2.5,
        "Factor by which the time span of that search is longer; it uses twice as many frames.",
        "no start out of five of `hard_skirt_4cam` has the opposite heading; with 2 one has",
        least=1,
    )
    stout: float = setting(
        3.0,
        "Excess of girth over the template's from which on a start is doubtful, because hardly"
        " any standing person has it.",
        unit="standard deviations of the prior",
        least=0,
    )


class StartConfig(Config):
    """All settings of the automatic start."""

    frames: FrameChoice = part(FrameChoice, "The frames of the start.")
    headings: HeadingConfig = part(HeadingConfig, "The headings that are tried.")
    spread: SpreadConfig = part(SpreadConfig, "The noise of searches without a known pose.")
    search: PoseSearchConfig = part(PoseSearchConfig, "The searches for a pose in one frame.")
    cost: CostConfig = part(CostConfig, "The cost by which hypotheses are compared.")
    shape: ShapeFitConfig = part(ShapeFitConfig, "The fit of the body's shape.")
    acceptance: AcceptanceConfig = part(AcceptanceConfig, "The conditions for a good start.")
    filter: FilterConfig = Field(
        default_factory=partial(
            FilterConfig.create,
            surface_weight=1.0,
            silhouette_recall_weight=2.0,
            contour_weight=4.0,
            part_colour_weight=0.0,  # the colours of the parts are not estimated yet
        ),
        description="Search and likelihood. A visual hull of few cameras is thicker than the "
        "person, so that a wrongly turned or bent body fills it as well. Silhouettes and edges "
        "therefore have more weight than in tracking.",
    )
