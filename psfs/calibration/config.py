"""Settings of the calibration of cameras."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, fraction, natural, part, positive, setting


class MarkerConfig(Config):
    """Detection of a wand's bright markers."""

    SOURCE: ClassVar = "by hand"

    brighter: int = setting(
        40,
        "Least difference between a marker and the scene without it.",
        unit="grey levels",
        least=1,
        most=255,
    )
    share: float = setting(
        0.5,
        "Least share of the brightest difference that a marker's pixels reach.",
        above=0,
        below=1,
    )
    rim: float = setting(
        0.15,
        "Share of the brightest difference above which pixels around a marker count to its centre.",
        least=0,
        below=1,
    )
    smallest: int = natural(2, "Fewest pixels of a marker.", unit="px")
    largest: float = setting(0.02, "Largest share of the picture of a marker.", above=0, most=1)
    off_line: float = positive(
        0.06, "Largest deviation of three markers from a line, as a share of the wand's length."
    )
    least_ratio: float = setting(
        1.1,
        "Least ratio of the halves of an uneven wand in a picture that distinguishes its ends.",
        least=1,
    )


class CalibrationConfig(Config):
    """Settings of a calibration. The standard deviations are priors for parameters that the footage
    does not determine."""

    SOURCE: ClassVar = "by hand"

    noise: float = setting(
        1.0,
        "Error of detected points beyond which the robust loss grows slower than the square.",
        "detectors reach 0.1 to 0.5",
        "px",
        above=0,
        below=1000,
    )
    outlier: float = setting(
        8.0,
        "Error beyond which a sighting is left out before the last bundle adjustment; of all "
        "sightings: beyond which the calibration has failed.",
        unit="px",
        above=0,
        below=1000,
    )
    shared_boards: int = setting(
        3,
        "Number of frames with a board that two cameras must share so that one can be placed by "
        "the other: a board's pose is known from each picture.",
        unit="frames",
        least=1,
        most=10_000,
    )
    shared_wands: int = setting(
        10,
        "Number of frames with a wand that two cameras must share for one to be placed "
        "relative to the other; a wand's few points need many frames.",
        unit="frames",
        least=1,
        most=10_000,
    )
    most_frames: int = setting(
        300,
        "Greatest number of examined frames, evenly spread over the footage.",
        unit="frames",
        least=3,
        most=100_000,
    )
    few_frames: int = setting(
        12,
        "Number of sightings below which a camera is reported as seeing too little.",
        unit="frames",
        least=1,
        most=10_000,
    )
    coverage: float = fraction(
        0.3, "Share of a camera's picture, of 8 x 6 cells, that should have held the target."
    )
    centre_sigma: float = setting(
        0.05,
        "Standard deviation of the principal point from the picture's middle.",
        "by hand: lenses are well within it",
        "of the picture's width",
        above=0,
        below=10,
    )
    aspect_sigma: float = setting(
        0.01,
        "Standard deviation of the ratio of fx and fy around 1.",
        "by hand: lenses are well within it",
        above=0,
        below=10,
    )
    lens_sigma: float = setting(
        0.3,
        "Standard deviation of the distortion's k1 and k2.",
        "by hand: lenses are well within it",
        above=0,
        below=10,
    )
    tangential_sigma: float = setting(
        0.01,
        "Standard deviation of the distortion's p1 and p2.",
        "by hand: lenses are well within it",
        above=0,
        below=10,
    )
    false_alarms: float = setting(
        1e-3, "Probability that a sound camera, or its intrinsics, is accused (F tests).", above=0,
        below=1,
    )  # fmt: skip
    false_share: float = fraction(
        0.1,
        "Share of a camera's sightings that may be false detections; with more, the camera "
        "disagrees.",
    )
    markers: MarkerConfig = part(MarkerConfig)
