"""Settings of tracking: recovery, smoothing, triangulation."""

from __future__ import annotations

from psfs.cameras.config import TriangulationConfig
from psfs.common.config import Config, nonnegative, part, positive, setting


class RecoveryConfig(Config):
    """When a body counts as lost: if its misfit (see `apf.likelihood.base`) is above `ratio` times
    the median of the last good frames' misfits, but at least `least`, see `recovery.Judge`."""

    ratio: float = setting(
        2.0,
        "Ratio of the limit to the median misfit of the last good frames.",
        "tuned",
        above=1,
    )
    least: float = positive(
        0.4,
        "Least value of the limit; misfits of good frames differ by as much.",
        "tuned",
    )


class SmoothingConfig(Config):
    """Smoothing of a track."""

    cutoff: float = positive(
        6.0,
        "Frequency of motion that keeps half of its amplitude (where the stated deviation is the "
        "usual one).",
        "the custom of gait analysis (Winter 2009)",
        "Hz",
        flag="--cutoff",
        flag_help="smoothing: motion this fast keeps half of its amplitude",
        metavar="HZ",
    )
    lag: int | None = setting(
        None,
        "Number of frames to look ahead; none for all that follow.",
        "the whole track is known",
        "frames",
        least=0,
        most=1_000_000,
        flag="--lag",
        flag_help="look so many frames ahead, as a program that runs live could",
        metavar="FRAMES",
    )
    hold_feet: bool = setting(
        True,
        "Whether feet that stand are held at one place. With a fixed lag they are not, because the "
        "end of a stance is not known yet.",
        "a standing foot does not slide",
    )


class TriangulatedConfig(Config):
    """Conversion of keypoints to a track without a body."""

    triangulation: TriangulationConfig = part(TriangulationConfig)
    longest_gap: float | None = nonnegative(
        None,
        "Longest gap that is filled; none to fill all.",
        "all are filled",
        "s",
        flag="--longest-gap",
        flag_help="triangulate: leave longer gaps open, blank in the files",
        metavar="S",
    )
    low_pass: float = nonnegative(
        0.0,
        "Frequency of a Butterworth filter; 0 for none. 6 Hz is usual for walking.",
        "off",
        "Hz",
        flag="--low-pass",
        flag_help="triangulate: Butterworth filter of the points, such as 6; 0 for none",
        metavar="HZ",
    )


#: The file name of each format.
EXPORTS = {
    "bvh": "motion.bvh",
    "c3d": "motion.c3d",
    "trc": "motion.trc",
    "mot": "motion.mot",
    "csv": "angles.csv",
    "glb": "motion.glb",
    "person": "person.glb",
    "gait": "gait.json",
}
#: Written on request alone, into a folder of this name: for OpenSim, a model scaled to the body and
#: its inverse kinematics, see `apf.formats.opensim`.
OPENSIM, OPENSIM_FOLDER = "osim", "opensim"
#: Written on request alone, too: the person's surface as USD, or a mesh per frame into a folder.
USD, MESHES, MESH_FOLDER = "usd", ("ply", "obj"), "meshes"
#: The formats that need joint positions only, no body model.
OF_POINTS = ("c3d", "trc", "gait")
