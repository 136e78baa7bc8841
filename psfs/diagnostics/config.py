"""Definitions of the diagnostics' scores, which are read without NumPy."""

from __future__ import annotations

#: Share of a silhouette up to which what differs is noise: of parts beside the largest one, of what
#: lies beyond the volume or a hull.
SPECKLE_SHARE = 0.02

DEFINITION = (
    "IoU of the reprojected surface voxels with the silhouette that they were made of: the pixels "
    "whose silhouette likelihood is above 0.5, within the projection of the reconstruction volume "
    "and beyond it where a part lies mostly within, "
    f"less speckle (5x5 median; parts under {SPECKLE_SHARE:.0%} of the largest one)"
)
