"""Settings of the diagnostics."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, fraction, natural, nonnegative, part, positive, setting


class ConsistencyConfig(Config):
    """Criteria by which a camera disagrees with the others, see
    `psfs.diagnostics.camera_consistency`."""

    SOURCE: ClassVar = "by hand; the tests hold it on sequences with one spoilt camera"

    samples: int = natural(4, "Number of examined frames, spread over the sequence.")
    low_share: float = fraction(
        0.6,
        "Share of the others' median IoU below which a camera is reported.",
        "at 0.7 a sound camera of `synth_salsa_4cam_hd` with a share of 0.68 was left out, "
        "because with few cameras each view carves another part of the shape",
    )
    agrees: float = fraction(
        0.8,
        "Share of its silhouette that must lie within the others' shape before furniture explains "
        "what it lacks.",
    )
    near: float = fraction(
        0.15,
        "Distance from the others' shape up to which a camera's silhouette is the person's, as a "
        "share of that shape's height; what lies farther away is clutter.",
        "by hand: with it rafters that touch the head accuse no camera of four or six",
    )
    agreeing: float = fraction(
        0.2,
        "Median IoU of the other cameras below which these do not agree among themselves, or "
        "no person is visible.",
    )
    voxels: int = natural(250_000, "Greatest number of voxels of the coarse shapes.")
    camera_share: float = fraction(
        0.5, "Share of the cameras that must see the space in which the coarse shapes are carved."
    )
    full: float = fraction(0.5, "Share of the picture that a person's silhouette fills at most.")
    least_contrast: float = nonnegative(
        2.0, "Standard deviation below which a picture is of one colour.", unit="grey levels"
    )
    lags: tuple[int, ...] = setting(
        (-20, -15, -10, -5, 5, 10, 15, 20),
        "Lags by which a camera's pictures may come late, or early, that are tried.",
        unit="frames",
    )
    rise: float = fraction(0.1, "Increase of the IoU that a lag needs in order to be reported.")


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
    """Criteria by which footage is faulty, see `psfs.diagnostics.faults`."""

    SOURCE: ClassVar = (
        "set between what the sequences at hand show untouched and what they show spoilt: every "
        "two cameras exchanged, every camera 2 to 10 frames late"
    )

    longest_side: int = setting(320, "Longest side of the small pictures.", unit="px", least=16)
    window: tuple[int, int] = setting(
        (60, 200),
        "Least and greatest number of consecutive frames that are examined.",
        unit="frames",
    )
    pixels: float = setting(
        1.5e9,
        "Greatest number of pixels that are decoded, which bounds the number of examined frames.",
        unit="px",
        above=0,
        most=1e15,
    )
    samples: int = natural(
        24, "Number of frames among those whose pictures are kept.", unit="frames"
    )
    longest_lag: float = nonnegative(
        2.0, "Greatest lag of a camera, late or early; at most a third of the frames.", unit="s"
    )
    least_lag: int = natural(
        2,
        "Least lag that is reported; smaller lags are not distinguished from differences of "
        "exposure.",
        unit="frames",
    )
    lag_gain: float = setting(
        1.1,
        "Least factor between the costs without and with the lag for the lag to count.",
        "untouched sequences: up to 1.06",
        least=1,
    )
    exchange_share: float = fraction(
        0.92,
        "Greatest ratio of the cost after an exchange to the cost before for cameras to count "
        "as exchanged.",
        "untouched sequences: above 1.1",
    )
    mirror_share: float = fraction(
        0.6,
        "The same ratio if the pictures of all cameras are mirrored, and for a calibration of "
        "another convention.",
    )
    flip_share: float = fraction(
        0.8,
        "The same ratio for the pairs of one camera whose pictures are mirrored or upside down.",
        "untouched cameras, late ones and those of other takes: above 0.9",
    )
    healed: float = fraction(
        0.9,
        "Greatest ratio of a late camera's cost after the shift to the cost before.",
        "late cameras: up to 0.83; those of other takes: from 0.97",
    )
    foreign_motion: float = nonnegative(
        0.85,
        "Least share of the motion that the others do not see of a camera that films other things.",
        "cameras that were turned: up to 0.75",
    )
    foreign_cost: float = nonnegative(0.06, "Least cost of a camera that films something else.")
    disagreeing: float = nonnegative(
        0.075,
        "Cost above which the cameras do not fit each other at all.",
        "untouched sequences: up to 0.061",
    )
    lens_share: float = fraction(
        0.9,
        "Greatest ratio of the cost with a lens's distortion to the cost without for the "
        "distortion to count as dropped: of all cameras, or of the one without.",
        "sound cameras: from 1.0 on; dropped: 0.47 to 0.97 of one camera, 0.64 to 1.0 of all",
    )
    turned_ratio: float = setting(
        2.5,
        "Least factor between a camera's cost and the others' for a search of its rotation.",
        least=1,
    )
    turned_cost: float = nonnegative(
        0.045,
        "Least cost of a camera for a search of its rotation.",
        "0.035 among four frames of four cameras",
    )
    turned_share: float = fraction(
        0.5,
        "Greatest ratio of a camera's cost after a rotation to the cost before for it to count"
        " as turned.",
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
