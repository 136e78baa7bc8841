"""Settings of the automatic start and of the fit to joints, in parts.

Where a default names no other source it was tuned on the starts of the shared walks
(`synth_walk_4cam`, `synth_walk_8cam`, `synth_box_4cam`, `bodytrack_walk`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

from apf.filters.config import FilterConfig


@dataclass(frozen=True)
class FrameChoice:
    """Which frames a start looks at, and what is a person in them."""

    n_fitted: int = 10
    """Frames that the body is fitted to."""
    duration: float = 1.0
    """s over which they are spread: a stride, so that legs part. Who stoops for 0.8 s comes out a
    hundredth shorter by those, and a high kick in 1.2 s does the same."""
    n_between: int = 1
    """About so many frames between two of them, which only lead from one to the next."""
    n_searched: int = 4
    """Of the fitted frames so many are searched over all headings, first and last among them."""
    min_voxels: int = 200
    """Fewest surface voxels that can be a person."""
    min_part: float = 0.05
    """Connected parts smaller than this share of the largest are debris ..."""
    min_near_part: float = 0.01
    """... or than this one, if they are near those that are none: a head without its neck."""
    near: float = 0.15
    """m, how near."""
    n_looks: int = 12
    """So many later frames are looked at for one in which the person stands taller; 0: none."""
    taller: float = 1.08
    """By this factor at least; else the first ones show the person well enough. By hand."""


@dataclass(frozen=True)
class HeadingConfig:
    """Which directions a person may look in, and which of them are followed up."""

    n_headings: int = 8
    """Headings from which the search begins, evenly around."""
    n_kept: int = 3
    """So many of the best go on."""
    separation: float = 0.8
    """rad by which their directions differ at least: the same direction need not go on twice."""
    max_first_ratio: float = 1.4
    """Limbs are searched for in hypotheses whose cost is at most so many times the least one: limbs
    amiss cost up to a third more."""
    max_cost_ratio: float = 1.2
    """Hypotheses are then followed whose cost is at most so many times the least one."""
    backwards_cost: float = 0.25
    """People look where they go: share by which a cost grows when they go backwards."""
    min_way: float = 0.25
    """m that the person must move over the first frames for that to count."""


@dataclass(frozen=True)
class SpreadConfig:
    """Standard deviations of the searches that know no pose, in their first layer."""

    root_horizontal: float = 0.08
    """m, of the root along x and y: the voxels' middle says where it is."""
    root_vertical: float = 0.06
    """m, of the root along z."""
    root_tilt: float = 0.15
    """rad, of the root about x and y: people stand upright."""
    root_heading: float = 0.35
    """rad, of the root about z: about half the angle between two headings."""
    body_share: float = 0.2
    """Of another axis, when the whole body is searched for: share of what its limits span."""
    body_max: float = 0.6
    """At most so many rad of it."""
    limb_share: float = 0.25
    """As `body_share`, when one limb is searched for."""
    limb_max: float = 0.8
    """At most so many rad of it."""

    def root(self, kind: str) -> float:
        """Return the deviation of the root's axis of this kind (`tx` .. `rz`), m or rad."""
        return {
            "tx": self.root_horizontal, "ty": self.root_horizontal, "tz": self.root_vertical,
            "rx": self.root_tilt, "ry": self.root_tilt, "rz": self.root_heading,
        }[kind]  # fmt: skip


@dataclass(frozen=True)
class PoseSearchConfig:
    """The searches for a pose in one frame."""

    n_particles_body: int = 300
    """Particles of the search for a whole body."""
    n_particles_limb: int = 150
    """Particles of the search for a limb."""
    n_particles_near: int = 100
    """Particles of the search near a pose."""
    noise: float = 1.0
    """Scale of the deviations of `SpreadConfig` in the first layer."""
    noise_decay: float = 0.75
    """Its factor from layer to layer."""
    near_noise: float = 0.1
    """Scale of the body's own sigma in the search near a pose."""
    n_limb_starts: int = 4
    """Poses from which a limb is searched for: as it was, at rest, and elsewhere."""
    n_size_steps: int = 4
    """Steps of the fit of size and girth to one frame."""
    trunk_low: float = 0.5
    """The trunk stands amid the voxels above this share of the height ..."""
    trunk_high: float = 0.75
    """... and below this one: from the hips to the chest (Drillis & Contini 1966)."""
    part_margin: float = 0.1
    """Of a body without head or feet the voxels up to this share of the height beyond the hips are
    looked at (the belly ends there)."""


@dataclass(frozen=True)
class CostConfig:
    """What hypotheses are compared by: likelihood error times registration error to a power."""

    registration_exponent: float = 0.3
    """1 % of registration error counts as this share of 1 % of likelihood error."""
    surface_scale: float = 0.04
    """m at which a point is half unexplained (Geman & McClure 1987)."""
    bend: float = 0.003
    """Unexplained share that counts as much as one joint bent by `bend_range`."""
    bend_range: float = 0.25
    """Share of an axis's range."""
    overlap: float = 0.1
    """Unexplained share that counts as much as parts wholly in each other."""

    def of(self, error: float, registration_error: float) -> float:
        """Return the cost; the less the better."""
        return error * registration_error**self.registration_exponent


@dataclass(frozen=True)
class ShapePrior:
    """Standard deviations around the template, of logs of scales where no unit is named."""

    size: float = 0.08
    """Of the whole body's size; statures of adults vary by 4 % within a sex."""
    girth: float = 0.15
    """Of all radii beside the size."""
    length: float = 0.025
    """Of a bone's length beside the size."""
    radius: float = 0.08
    """Of a part's radius beside size and girth."""
    stature: float = 0.005
    """m, of a known stature: as exactly as people state it."""
    angle: float = 1.0
    """rad, of an angle from rest; only decides what the voxels leave open."""


@dataclass(frozen=True)
class StandingConfig:
    """The feet stand on the floor, of which silhouettes say little: shoes look like floor, and
    shadows like shoes."""

    height: float = 0.0
    """m, of the floor."""
    reach: float = 0.3
    """m: a person whose lowest voxels are less far above the floor stands on it; 0 for nobody. By
    hand: feet and shins that silhouettes lose are shorter."""
    below: float = 0.1
    """m that the lowest voxels may lie below it: thick hulls."""
    ankle: float = 0.012
    """m, deviation of the lower ankle from its height when the foot is flat. By hand."""
    lifted: float = 0.1
    """m by which both feet may be off the floor until that counts half (Geman & McClure 1987)."""

    def stands(self, lowest: float) -> bool:
        """Return whether a person with the lowest voxels at z = `lowest` m stands on the floor."""
        return self.reach > 0 and -self.below < lowest - self.height < self.reach


@dataclass(frozen=True)
class ShapeFitConfig:
    """The least-squares fit of the body's shape to the clouds of several frames."""

    prior: ShapePrior = field(default_factory=ShapePrior)
    """What is known of people's shapes."""
    standing: StandingConfig = field(default_factory=StandingConfig)
    """What is known of their feet."""
    n_distances: float = 300.0
    """What all clouds together count: as many independent distances. The body is not made of cones,
    and wrong in the same way in every frame: more frames know no more of it."""
    noise: float = 0.02
    """m, deviation of one of them."""
    stray: float = 0.002
    """Share of the points below the feet or above the head."""
    spacing: float = 0.06
    """m between points on the body's surface."""
    n_points: int = 800
    """Points of each cloud that are compared."""
    damping: float = 1e-3
    """Share of a pose's own normal matrix added to its diagonal (Levenberg 1944)."""
    n_steps: int = 6
    """Gauss-Newton steps."""
    first_reach: float = 0.08
    """m at which a point counts a quarter in the first step."""
    last_reach: float = 0.03
    """m, in the last step; those between are spaced geometrically."""


@dataclass(frozen=True)
class AcceptanceConfig:
    """When a start is good enough, and what speaks against one."""

    good: float = 0.3
    """Registration error above which a start is looked for again with other random numbers: what
    chance decides, several attempts decide better, and the score tells which."""
    n_attempts: int = 3
    """So many times in all."""
    hopeless: float = 0.55
    """Registration error above which no body was found."""
    rival: float = 1.1
    """A start is doubtful with a rival that fits only by this factor worse ..."""
    stout: float = 3.0
    """... or a girth so many deviations of the prior above the template's: hardly anybody who
    stands has one."""


def _start_likelihood() -> FilterConfig:
    return FilterConfig.of(
        surface_weight=1.0, silhouette_recall_weight=2.0, contour_weight=4.0,
        part_colour_weight=0.0,  # nothing is learnt yet
    )  # fmt: skip


@dataclass(frozen=True)
class StartConfig:
    """Everything that the automatic start goes by."""

    frames: FrameChoice = field(default_factory=FrameChoice)
    headings: HeadingConfig = field(default_factory=HeadingConfig)
    spread: SpreadConfig = field(default_factory=SpreadConfig)
    search: PoseSearchConfig = field(default_factory=PoseSearchConfig)
    cost: CostConfig = field(default_factory=CostConfig)
    shape: ShapeFitConfig = field(default_factory=ShapeFitConfig)
    acceptance: AcceptanceConfig = field(default_factory=AcceptanceConfig)
    filter: FilterConfig = field(default_factory=_start_likelihood)
    """Search and likelihood. Hulls of few cameras are thicker than the person, and a body turned or
    bent wrongly fills them as well; what it covers in the pictures, and their edges, tell more than
    in tracking."""


@dataclass(frozen=True)
class JointFitConfig:
    """The fit of body and pose to 3-D joints."""

    joint: float = 0.01
    """m, deviation of a joint's position."""
    scale: float = 0.3
    """Deviation of the log of a bone's scale; only decides what the joints leave open."""
    angle: float = 3.0
    """rad, deviation of an angle from rest; likewise."""
    max_log_scale: float = 1.0
    """Largest log of a bone's scale, and the negative of the smallest: from 0.37 to 2.7 times."""
    min_joints: int = 8
    """Known joints that are asked for, or all of a body with fewer: enough for the root, and a
    joint in every limb."""
    n_headings: int = 4
    """Headings that are tried, evenly around."""
    n_trial: int = 8
    """Evaluations after which the best of the headings is gone on with."""
