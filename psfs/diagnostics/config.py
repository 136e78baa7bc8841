"""Settings of the diagnostics."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, fraction, natural, nonnegative, part, positive, setting


class LimbConfig(Config):
    """Medial axes of limbs, which all cameras see, as measurements of these."""

    SOURCE: ClassVar = (
        "by hand on the eight laboratory takes, whose worst directions .1 and .3 measurements per "
        "point and gates of 5 and 2.5 px hardly change"
    )

    smooth: float = positive(2.0, "Standard deviation of the contours' smoothing.", unit="px")
    opposite: float = fraction(0.9, "Least cosine between the edges of a limb.")
    narrowest: float = positive(5.0, "Least width of a limb in a picture.", unit="px")
    thinnest: float = positive(0.018, "Least width of a limb.", unit="statures")
    widest: float = positive(0.13, "Greatest width of a limb.", unit="statures")
    alike: float = setting(1.4, "Greatest ratio of a limb's widths in two cameras.", above=1)
    straight: float = positive(
        0.35, "Greatest angle between a limb's direction and the plane in which a camera sees it.",
        unit="rad",
    )  # fmt: skip
    views: int = natural(3, "Fewest cameras that see a point.")
    per_camera: int = natural(800, "Points of each camera that are searched in the others.")
    around: float = positive(0.75, "Depth that is searched around the middle.", unit="statures")
    step: float = positive(0.011, "Step of the searched depths.", unit="statures")
    apart: float = positive(0.07, "Distance of another depth from the best.", unit="statures")
    lead: float = positive(0.5, "Cameras by which the best depth must agree better than another.")
    gate: float = positive(
        5.0, "Distance of a point from an axis up to which they agree.", unit="px"
    )
    noise: float = positive(0.3, "Least standard deviation of a point.", unit="px")
    information: float = positive(
        0.1, "Independent measurements per point; neighbours are wrong alike."
    )


class AlignmentConfig(Config):
    """Settings of the correction of a rig that is slightly off, see
    `psfs.diagnostics.alignment`."""

    SOURCE: ClassVar = (
        "by hand on `hard_real_5cam`; laboratory sequences whose calibration was spoilt by 0.3 to "
        "0.7 degrees, and exact ones, confirmed it"
    )

    on: bool = setting(True, "Whether to correct the rig.")
    turn: float = positive(
        0.008, "Standard deviation of a camera's rotation about an axis.", unit="rad"
    )
    shift: float = positive(
        0.01, "Standard deviation of the error of a camera's position along an axis.", unit="m"
    )
    focal: float = positive(0.005, "Standard deviation of the relative error of a focal length.")
    time: float = positive(
        0.5,
        "Standard deviation of a camera's offset in time; larger offsets are lags of whole frames.",
        unit="frames",
    )
    noise: float = positive(
        0.5,
        "Least standard deviation of the distance of a frontier point from its epipolar line.",
        unit="px",
    )
    gate: float = positive(
        4.0,
        "Greatest distance between frontier points that are matched in the last round; the first "
        "rounds match four times and twice as far.",
        unit="px",
    )
    bend: float = positive(
        2.0,
        "Greatest change of a tip's speed from frame to frame, and difference between two cameras.",
        "with 1 half as many tips count, and few fast ones",
        "px/frame",
    )
    judged_bend: float = positive(
        1.0,
        "The same of the tips by which a correction is judged.",
        "with 2 that of `hard_skirt_4cam`, spoilt, every second frame, is rejected",
        "px/frame",
    )
    information: float = setting(
        0.1,
        "Number of independent measurements per measurement of a tip that rests; below 1, because "
        "consecutive frames are similar.",
        above=0,
        most=1,
    )
    half_speed: float = positive(
        1.0,
        "Speed of a tip at which its measurement is worth half of an independent one more.",
        "one number for all tips leaves times to slow ones, which are many",
        "px/frame",
    )
    #: Medial axes of limbs, in the last matchings.
    limbs: LimbConfig = part(LimbConfig)
    n_rounds: int = natural(4, "Number of matchings of the frontier points.")
    n_steps: int = natural(2, "Number of Gauss-Newton steps after each matching.")
    n_last: int = natural(5, "Most matchings with the narrowest gate, of all frames.")
    settled: float = nonnegative(
        0.005, "Change of the cameras' times below which there are no more.", unit="frames"
    )
    least_rows: int = natural(4, "Least number of measurements per unknown.")
    block: int = natural(
        10,
        "Length of the stretches that are alternately fitted and held out to judge the correction.",
        unit="frames",
    )
    least_moved: float = nonnegative(
        1.6 / 640,
        "Least correction, root mean square over the cameras, as a share of the picture's "
        "longer side.",
        "exact rigs seem off by up to 1.4 of 640 px, for silhouettes lose hair and gain shadows",
    )
    share: float = fraction(0.5, "Share to which the residuals of the held-out frames must shrink.")
    sound: float = nonnegative(
        0.45,
        "Residual in small pictures below which a rig counts as sound.",
        "exact rigs: 0.25 to 0.36 px, `hard_real_5cam`: 1.2 px",
        unit="px",
    )
    first_share: float = fraction(
        0.75,
        "Share to which residuals must shrink in small pictures before larger ones are examined.",
    )
    longest_side: int = setting(640, "Longest side of the larger pictures.", unit="px", least=16)


class OccluderConfig(Config):
    """Settings of the search for furniture that hides people, see `psfs.diagnostics.occluders`."""

    SOURCE: ClassVar = (
        "by hand on `hard_chair_6cam`; laboratory sequences with something painted over one or two "
        "cameras, and clean ones, confirmed it"
    )

    on: bool = setting(True, "Whether to search for furniture; Song et al. have no such step.")
    samples: int = setting(
        64,
        "Number of examined frames, spread over the sequence.",
        "with 25 of 122 frames a twelfth of the hidden pixels was not found",
        unit="frames",
        least=2,
    )
    longest_side: int = setting(640, "Longest side of the examined pictures.", unit="px", least=16)
    voxels: int = setting(
        600_000, "Greatest number of voxels of the grid around the person.", least=1000
    )
    agreeing: int = setting(
        3,
        "Least number of cameras that must show unexplained foreground.",
        "two find specks in clean footage",
        unit="cameras",
        least=2,
    )
    denying: int = natural(
        2, "Greatest number of cameras that are hidden from the same place at once.", unit="cameras"
    )
    margin: int = nonnegative(
        3,
        "Distance from explained pixels within which foreground counts as explained, too.",
        unit="px",
    )
    least_frames: int = natural(
        2, "Least number of frames in which a pixel must contradict what the other cameras see."
    )
    least_share: float = fraction(
        0.1,
        "Least share of such frames among those in which the pixel either shows the person or "
        "contradicts the other cameras.",
    )
    least_confirmed: float = nonnegative(
        0.5,
        "Least ratio of a camera's pixels that show the person to those that contradict the "
        "other cameras; below it, the camera has another fault.",
    )
    gap: int = natural(13, "Width of the holes that are filled.", unit="px")
    least_pixels: int = natural(300, "Number of pixels below which a region is noise.", unit="px")


class FaultConfig(Config):
    """The tests of faults, see `psfs.diagnostics.fault`."""

    SOURCE: ClassVar = "by hand; docs/trust.md has the table of sound and spoilt takes"

    false_alarms: float = setting(
        1e-3, "Probability of each test that footage without the fault is accused.", above=0, most=1
    )
    longest_side: int = setting(320, "Longest side of the small pictures.", unit="px", least=16)
    longest_offset: float = nonnegative(
        2.0, "Longest offset of a camera in time; at most a third of the frames.", unit="s"
    )


class InViewConfig(Config):
    """Least view of the person that each camera should have, see
    `psfs.diagnostics.person_in_view`."""

    SOURCE: ClassVar = "by hand"

    seen: float = fraction(0.7, "Share of the frames in which a camera should see somebody.")
    whole: float = fraction(0.8, "Share of these in which it should see the whole person.")
    height: float = positive(
        100.0,
        "Height of the person in a picture.",
        "the sequences of docs/accuracy.md show people 150 to 390 px high",
        unit="px",
    )
