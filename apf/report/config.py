"""Settings of the verdict on a track."""

from __future__ import annotations

from typing import ClassVar

from psfs.common.config import Config, fraction, nonnegative, positive, setting


class QualityConfig(Config):
    """Limits of the verdict on a track without truth, see `apf/report/quality.py`."""

    SOURCE: ClassVar = "by hand, on synthetic walks and the recordings at hand"

    inside: float = setting(
        0.7,
        "Share inside the silhouettes at which a part is as likely right as wrong.",
        "wrong upper arms and thighs: 0.2 to 0.5, a wrong forearm 0.65, right parts 0.87 and more",
        above=0,
        below=1,
    )
    halved: float = positive(
        0.1,
        "Standard deviation of a limb's end that halves its confidence.",
        "half of the error from which `apf evaluate` counts a limb as lost",
        unit="m",
    )
    steepness: float = setting(
        4.0, "Power of that deviation by which the confidence falls.", above=0, most=100
    )
    explained: float = fraction(
        0.9,
        "Share of surface voxels near the body below which a frame should be checked.",
        "an arm is more than the rest; hulls of few cameras leave up to 0.06 without a fault",
    )
    near: float = fraction(
        0.88,
        "Share of keypoints near their points on the body below which a frame should be checked.",
        "sound keypoints: 0.92 and more; left and right exchanged in one camera of five: 0.86",
    )
    good: float = fraction(0.02, "Greatest share of doubtful frames of a good track.")
    bad: float = fraction(0.25, "Least share of doubtful frames of a bad track.")
    doubtful_parts: float = fraction(
        0.1, "Least share of doubtful parts that confirms, with `overlap`, that a track is bad."
    )
    overlap: float = nonnegative(
        0.76,
        "Overlap of body and silhouettes, as a share of that of the voxels, below which they do "
        "not fit.",
        "right tracks: 0.80 and more, in a skirt 0.75",
    )
    away: float = fraction(
        0.5, "Share of frames with voxels away from the body that confirms that a track is bad."
    )
    fitting: float = fraction(
        0.25, "Share of keypoints near the body below which a track is certainly bad."
    )
