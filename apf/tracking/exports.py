"""The files that `apf export` writes."""

from __future__ import annotations

#: The file name of each format.
EXPORTS = {
    "bvh": "motion.bvh",
    "c3d": "motion.c3d",
    "trc": "motion.trc",
    "mot": "motion.mot",
    "csv": "angles.csv",
    "glb": "motion.glb",
    "gait": "gait.json",
}
#: Written on request alone, into a folder of this name: for OpenSim, a model scaled to the body and
#: its inverse kinematics, see `apf.formats.opensim`.
OPENSIM, OPENSIM_FOLDER = "osim", "opensim"
#: The formats that need joint positions only, no body model.
OF_POINTS = ("c3d", "trc", "gait")
