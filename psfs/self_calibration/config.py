"""Settings of the calibration by a person."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, fraction, natural, nonnegative, part, positive, setting
from psfs.diagnostics.config import AlignmentConfig, LimbConfig
from psfs.self_calibration.points.config import PointsConfig

#: Provenance of what was set while the calibration by a person was developed.
_BY_HAND = "by hand on `synth_walk_4cam` and `synth_run_6cam`"
#: The same of what concerns somebody who stays in place.
_GROWN = "by hand on `synth_pickup_6cam`, `synth_box_4cam` and `synth_jacks_6cam`"


#: Tips count alike, however fast.
_ALIKE = {"bend": 1.0, "information": 0.2, "half_speed": 1e9}


class OutlineConfig(Config):
    """Outline of the person in a silhouette."""

    SOURCE: ClassVar = _BY_HAND

    closed: float = fraction(
        0.012, "Gaps that are closed, as a share of the picture's longest side."
    )
    near: float = fraction(
        0.05, "Gaps between parts that belong together, as a share of the same side."
    )
    part: float = fraction(0.02, "Least area of such a part, as a share of the largest.")


class UprightConfig(Config):
    """Fit of one camera's tilt, roll and height to silhouettes of somebody upright."""

    SOURCE: ClassVar = _BY_HAND

    head: float = setting(
        0.12, "Share of the person's apparent height that counts as head.", above=0, below=0.5
    )
    feet: float = setting(
        0.2, "Share of the person's apparent height that counts as feet.", above=0, below=0.5
    )
    elevation: float = positive(0.02, "Standard deviation of the head's elevation.", unit="rad")
    azimuth: float = positive(
        0.04, "Standard deviation of the head's azimuth from the feet's.", unit="rad"
    )
    information: float = positive(0.1, "Independent measurements per frame.")
    roll: float = positive(0.06, "Standard deviation of cameras' roll.", unit="rad")
    tilt: float = setting(-0.1, "Usual tilt of cameras, upwards.", unit="rad", least=-1.5, most=1.5)
    tilt_spread: float = positive(0.5, "Standard deviation of the tilt.", unit="rad")
    height: float = positive(0.9, "Usual height of cameras.", unit="statures")
    height_spread: float = positive(0.35, "Standard deviation of the height.", unit="statures")
    fewest: int = setting(8, "Fewest frames that must show the whole person.", least=3)
    turn: float = positive(
        0.105, "Turn of the fitted tilt, upwards and downwards, that is tried too.", unit="rad"
    )


class PairConfig(Config):
    """Comparison of two cameras at every angle and lag."""

    SOURCE: ClassVar = _BY_HAND

    planes: float = positive(0.006, "Noise of the touching planes' positions.", unit="statures")
    places: float = positive(0.1, "Noise of the person's places on the floor.", unit="statures")
    bobbing: float = positive(0.003, "Noise of the head's height.", unit="statures")
    window: float = positive(
        1.0, "Window that separates the head's steps from slower motion.", unit="s"
    )
    outlier: float = positive(
        0.15, "Deviation from the smoothed distance, as a share, beyond which a frame is not used."
    )
    nearest: float = positive(
        0.3, "Least distance of the line between two cameras from the person.", unit="statures"
    )
    middle: float = positive(0.55, "Height of the person's middle.", unit="statures")
    shortest: float = positive(
        0.2, "Shortest line between two cameras that are compared.", unit="statures"
    )
    fewest: int = setting(12, "Fewest frames that are compared.", least=3)
    share: float = setting(0.3, "The same as a share of the shorter recording.", above=0, most=1)


class BeamConfig(Config):
    """Search for the angles and lags of all cameras in the tables of pairs."""

    SOURCE: ClassVar = _BY_HAND

    kept: int = natural(80, "Partial arrangements that are kept.")
    places: int = natural(12, "Places that are tried of each camera.")
    same_angle: int = nonnegative(2, "Steps of the angle up to which arrangements are the same.")
    same_lag: int = nonnegative(2, "Steps of the lag up to which arrangements are the same.")


class GrowthConfig(Config):
    """Growth of the rig camera by camera, where the tables of pairs do not tell it."""

    SOURCE: ClassVar = _GROWN

    angles: int = setting(24, "Number of angles around the person that are tried.", least=8)
    elevations: tuple[float, ...] = setting(
        (-0.1, 0.04, 0.18, 0.32, 0.46, 0.6),
        "Elevations of a camera over the person's horizon that are tried.",
        unit="rad",
    )
    steady: float = fraction(
        0.1, "Share to which two cameras' usual difference counts where places are compared."
    )
    rounds: int = natural(5, "Rounds in which a new camera alone is adjusted.")
    places: int = natural(12, "Places of a camera that are tried, per rig before it.")
    tried: int = natural(32, "Rigs of as many cameras that are adjusted.")
    kept: tuple[int, ...] = setting(
        (14, 12, 10, 6, 4, 4), "Rigs of two, three, ... cameras that are kept."
    )
    same: float = positive(0.14, "Turn up to which two rigs are the same.", unit="rad")
    grown: int = natural(3, "Most rigs of all cameras that are adjusted further.")
    worse: float = setting(
        1.15, "Multiple of the best rig's misfit up to which a rig is adjusted further.", least=1
    )


class AdjustmentConfig(Config):
    """Adjustment of all cameras to the silhouettes."""

    SOURCE: ClassVar = _BY_HAND

    nearest: float = positive(
        0.4, "Least distance of the line between two cameras from the person.", unit="m"
    )
    least_shared: int = natural(20, "Fewest outermost points by which two cameras are judged.")
    outermost: float = positive(
        1.5, "Multiple of the gate up to which outermost planes count as frontier points."
    )
    first: int = natural(4, "Rounds of the first adjustment.")
    second: int = natural(10, "Rounds of the finalists' adjustment.")
    gates: tuple[float, ...] = setting(
        (16, 8, 6, 4, 4, 2, 2, 2), "Gates of the last rounds.", unit="px"
    )
    passes: int = natural(6, "Most further passes over a rig that was grown.", _GROWN)
    near_gates: tuple[float, ...] = setting((4, 2), "Gates of a step of such a pass.", _GROWN, "px")
    far_gates: tuple[float, ...] = setting(
        (8, 4, 4, 2), "Gates after the step was prolonged.", _GROWN, "px"
    )
    farther: float = positive(5.0, "Multiple of the step by which it is prolonged.", _GROWN)
    fewer: float = fraction(0.97, "Share of the points that must still agree after it.", _GROWN)
    more: float = setting(
        1.01,
        "Multiple of the points that must agree after it; two passes of less are the last.",
        _GROWN,
        least=1,
    )
    settled: float = positive(0.0003, "Turn below which a rig stays.", _GROWN, "rad")
    last: int = natural(
        8,
        "Most passes with `near_gates` over the rig that was found.",
        "by hand on `synth_box_4cam` and `synth_salsa_4cam_hd`",
    )
    #: Steps while the arrangement is uncertain; lenses are kept.
    wide: AlignmentConfig = part(
        AlignmentConfig, turn=0.1, shift=0.3, focal=1e-4, time=5.0, **_ALIKE
    )
    #: Steps when the arrangement is known; lenses are kept.
    narrow: AlignmentConfig = part(
        AlignmentConfig, turn=0.05, shift=0.2, focal=1e-4, time=5.0, noise=0.25, **_ALIKE
    )
    #: Medial axes of limbs, in the last passes.
    limbs: LimbConfig = part(LimbConfig, per_camera=2400)
    lens: float = positive(
        0.03,
        "Step of the focal length's logarithm in each round, where only an angle of view is "
        "stated.",
    )

    def free_lenses(self) -> AdjustmentConfig:
        """Return these settings with focal lengths that are adjusted, too."""
        return self.replace(
            wide=self.wide.replace(focal=self.lens), narrow=self.narrow.replace(focal=self.lens)
        )


class FloorFitConfig(Config):
    """Up, floor and scale from the person."""

    SOURCE: ClassVar = _BY_HAND

    up: float = positive(
        0.026, "Standard deviation of the mean up of the single cameras.", unit="rad"
    )
    feet: float = positive(0.02, "Standard deviation of a lowest point over the floor.", unit="m")
    widths: tuple[float, ...] = setting(
        (16, 8, 8, 8), "Widths of the weights, one after another, as multiples of `feet`."
    )
    information: float = positive(0.1, "Independent frames per frame.")
    standing: float = setting(
        90,
        "Percentile of the heights of the topmost points that is the stature.",
        "by hand",
        "%",
        least=0,
        most=100,
    )


class VerticalConfig(Config):
    """Up from the vertical edges of the room."""

    SOURCE: ClassVar = "by hand on the eight laboratory takes and Pose2Sim's four videos"

    shortest: float = fraction(0.03, "Shortest edge, as a share of the picture's longest side.")
    longest: float = positive(0.3, "Angle from which on longer edges count alike.", unit="rad")
    around: float = positive(0.21, "Greatest angle from the person's up.", unit="rad")
    step: float = positive(0.0087, "Step of the directions that are tried.", unit="rad")
    width: float = positive(
        0.0087, "Deviation at which an edge has a quarter of its weight.", unit="rad"
    )
    rounds: int = natural(10, "Rounds of the least squares from the best direction tried.")
    apart: float = positive(0.044, "Angle from which on a direction is another one.", unit="rad")
    distinct: float = setting(
        1.5,
        "Multiple of the weight of edges in another direction that is needed.",
        "by hand: 1.6 to 5 of true rigs; 1 to 1.4, once 1.6, with pictures exchanged; 1.3 in a "
        "wrong direction of `utrecht_seated`",
        least=1,
    )


class RoomConfig(Config):
    """Rotations of the cameras from edges of the room that are parallel."""

    SOURCE: ClassVar = "by hand on the eight laboratory takes and Pose2Sim's four videos"

    horizontal: int = natural(2, "Most horizontal directions of edges.")
    step: float = positive(0.0044, "Step of the horizontal directions that are tried.", unit="rad")
    width: float = positive(
        1.5, "Distance of an edge's ends at which it has a quarter of its weight.", unit="px"
    )
    longest: float = positive(60.0, "Half length from which on edges count alike.", unit="px")
    clear: float = setting(
        2.0, "Multiple of the median direction's weight that a direction needs.", least=1
    )
    gate: float = positive(4.0, "Greatest distance of an edge's ends.", unit="px")
    noise: float = positive(0.15, "Least standard deviation of that distance.", unit="px")
    information: float = positive(
        8.0, "Independent measurements per edge; more than one, for silhouettes are wrong alike."
    )


class SliceConfig(Config):
    """Height of the floor from slices of the person's hull."""

    SOURCE: ClassVar = "by hand on the eight laboratory takes and their true masks"

    frames: int = natural(25, "Frames that are used.")
    around: float = positive(0.2, "Greatest distance from the lowest points.", unit="m")
    step: float = positive(0.01, "Distance of the slices.", unit="m")
    side: float = positive(0.6, "Half of a slice's side.", unit="m")
    cell: float = positive(0.03, "Cell of a slice.", unit="m")
    foot: float = positive(
        0.2,
        "Width of the largest slice above which it is a shadow on the floor.",
        "by hand: 0.10 to 0.15 m of true masks, 0.25 m and more with shadows",
        "m",
    )
    above: float = positive(0.05, "Height above it at which a shadow is no longer seen.", unit="m")
    thin: float = fraction(
        0.8,
        "Greatest area there of a shadow, as a share of the largest slice's.",
        "by hand: 0.35 to 0.72 in the laboratory",
    )
    lowest: float = fraction(
        0.1, "Area of the lowest slice of feet, as a share of the largest slice's."
    )


class PersonConfig(Config):
    """Settings of the calibration of cameras by a person who walks about."""

    SOURCE: ClassVar = _BY_HAND

    stature: float = setting(
        1.7,
        "Height of the person, which gives the scale where none is stated.",
        "an adult's",
        "m",
        above=0.3,
        most=3.0,
    )
    longest_lag: float = setting(
        1.5, "Longest time by which one camera may be behind another.", unit="s", least=0, most=60
    )
    longest_side: int = setting(640, "Longest side of the pictures used.", unit="px", least=64)
    most_frames: int = setting(
        300, "Number of frames of a camera that are used, the first ones.", least=20
    )
    table_rate: float = positive(
        15.0, "Frames per second at which lags are searched first.", unit="1/s"
    )
    angles: int = setting(36, "Number of angles around the vertical that are tried.", least=8)
    candidates: int = natural(40, "Number of arrangements from the search that are adjusted.")
    core: int = setting(
        8,
        "Most cameras that are searched together; of more, these see the whole person in most "
        "pictures, and the others are added to them one by one.",
        "by hand: the laboratory has up to eight cameras",
        least=3,
    )
    anchors: int = natural(4, "Number of these cameras with which another is compared.", "by hand")
    finalists: int = natural(3, "Number of these that are adjusted to frontier points.")
    least_frames: int = setting(
        40, "Fewest frames of a camera that must show the whole person.", least=8
    )
    worst_residual: float = positive(
        0.95,
        "Greatest distance of the outermost points of a camera and of others from epipolar lines, "
        "the median over the others of medians.",
        "by hand: up to 0.8 px in right rigs of the laboratory, 1.18 px in the best wrong one",
        "px",
    )
    worst_direction: float = positive(
        0.0044,
        "Greatest standard deviation of a camera's direction.",
        "between `synth_box_4cam` (0.0035 rad, 0.5 degrees off) and `synth_pickup_6cam` (0.0054, "
        "1.0 degrees off)",
        "rad",
    )
    sure_residual: float = positive(
        0.7, "The same distance above which other rigs are grown and compared.", _GROWN, "px"
    )
    worst_of_three: float = positive(
        0.6,
        "The same of three cameras, which agree about wrong arrangements, too.",
        "by hand: of somebody in place wrong ones differ by 0.76 px, right ones by 0.6",
        "px",
    )
    distinct: float = setting(
        1.4,
        "Multiple of the best arrangement's misfit that another one must exceed in some camera.",
        "by hand: 0.6 of a drawn walker on a circle, 1.6 to 1.9 in `synth_walk_4cam` and "
        "`synth_walk_8cam`",
        least=1,
    )
    worst_pair: float = positive(
        3.5,
        "Greatest median distance of any two cameras' outermost points from epipolar lines.",
        "by hand: up to 2.5 px in `synth_jacks_6cam` by a shadow, 4.6 px in the best wrong rig",
        "px",
    )
    least_motion: float = fraction(
        0.03,
        "Least standard deviation of a silhouette's edge, as a share of its height; the median "
        "over the cameras.",
        "by hand: 0.09 or more in the laboratory",
    )
    outline: OutlineConfig = part(OutlineConfig)
    upright: UprightConfig = part(UprightConfig)
    pairs: PairConfig = part(PairConfig)
    search: BeamConfig = part(BeamConfig)
    growth: GrowthConfig = part(GrowthConfig)
    adjustment: AdjustmentConfig = part(AdjustmentConfig)
    floor: FloorFitConfig = part(FloorFitConfig)
    verticals: VerticalConfig = part(VerticalConfig)
    room: RoomConfig = part(RoomConfig)
    slices: SliceConfig = part(SliceConfig)
    points: PointsConfig = part(PointsConfig)
