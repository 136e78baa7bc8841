"""Criteria by which pictures are faulty."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, fraction, nonnegative, setting


class PictureConfig(Config):
    """Criteria by which pictures are faulty, see `psfs.diagnostics.picture_faults`."""

    SOURCE: ClassVar = (
        "set between what the sequences at hand show untouched and what they show spoilt"
    )

    same_view: float = setting(
        0.85, "Least correlation of pictures with a background of the same view.", most=1
    )
    other_view: float = setting(
        0.6,
        "Correlation of pictures with their background below which they show different views.",
        "untouched sequences: 0.93 and more",
        most=1,
    )
    knocked: float = nonnegative(
        2.0,
        "Greatest shift between pictures and their background for a camera that was not moved.",
        "untouched sequences: below 1",
        "small pixels",
    )
    gain: float = nonnegative(
        0.1, "Least increase of the edges' correlation if the pictures are shifted back."
    )
    flicker: float = nonnegative(
        0.04,
        "Median change of the brightness from frame to frame above which the light flickers.",
        "untouched sequences: 0.015",
    )
    steady: float = fraction(
        0.6,
        "Share of the frames that show foreground in one place if the background contains the "
        "person.",
    )
    still: float = nonnegative(
        6.0,
        "Median deviation over time below which nothing moves at such a place.",
        unit="grey levels",
    )
    ghost_area: float = fraction(
        0.15,
        "Least area of such a place as a share of the silhouette's area; twice as much if only "
        "one frame shows it.",
    )
    ghost_edges: float = nonnegative(
        1.5,
        "Least ratio of the strength of the edges at its rim in the background to that in the "
        "frames.",
        "untouched sequences: 0.9; spoilt ones: 1.7 to 8",
    )
    ghost_seen: float = nonnegative(1.2, "The same ratio if several frames show the place.")
    cut: float = fraction(
        0.5,
        "Least share of the frames in which a silhouette touches the picture's border for a note.",
    )
    filled: float = fraction(0.5, "Share of a picture that a person's silhouette fills at most.")
    blank: float = nonnegative(
        2.0,
        "Standard deviation of a picture below which it shows nothing.",
        "untouched sequences: 20 and more",
        "grey levels",
    )
    frozen: float = nonnegative(
        0.01, "Change of a silhouette's area over time below which its camera hangs."
    )
    hung: int = setting(
        10, "Number of frames of one silhouette after which a camera hangs.", unit="frames", least=3
    )
    moving: float = nonnegative(
        0.05, "Change of the median camera's silhouette above which a camera that shows none hangs."
    )
