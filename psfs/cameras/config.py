"""Settings of triangulation, which are read without NumPy."""

from __future__ import annotations

from psfs.common.config import Config, fraction, positive, setting


class TriangulationConfig(Config):
    """Limits by which cameras are left out of a point, and points are left out."""

    max_error: float = positive(
        15.0,
        "Mean reprojection error that the cameras of a point must stay below; others are left out.",
        "Pose2Sim's default, for pictures about 1000 px high",
        "px",
        flag="--max-error",
        flag_help="triangulate: cameras are left out of a point until the mean reprojection "
        "error is below",
        metavar="PX",
    )
    min_confidence: float = fraction(
        0.3, "Confidence below which a keypoint counts as missing.", "Pose2Sim's default"
    )
    min_cameras: int = setting(2, "Fewest cameras that give a point.", "by geometry", least=2)
