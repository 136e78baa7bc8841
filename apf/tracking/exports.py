"""What `apf export` writes."""

from __future__ import annotations

#: What is written, and as what file.
EXPORTS = {
    "bvh": "motion.bvh",
    "c3d": "motion.c3d",
    "trc": "motion.trc",
    "mot": "motion.mot",
    "csv": "angles.csv",
    "glb": "motion.glb",
    "gait": "gait.json",
}
#: What needs no body, but points alone.
OF_POINTS = ("c3d", "trc", "gait")
