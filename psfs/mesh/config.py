"""Formats and smoothing of meshes."""

from __future__ import annotations

#: Of the files, by their endings.
FORMATS = ("ply", "glb", "obj")
#: Steps of Taubin smoothing: enough to hide the voxels, too few to lose fingers and noses.
SMOOTHING, MOST_SMOOTHING = 10, 1000
