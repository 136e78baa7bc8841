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
#: The formats that need joint positions only, no body model.
OF_POINTS = ("c3d", "trc", "gait")
