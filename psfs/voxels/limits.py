"""Bounds and defaults of voxels that flags state."""

from __future__ import annotations

#: Edges of voxels, least and greatest, m.
VOXEL_EDGES = (1e-6, 100.0)
#: Parts of a cloud with fewer voxels than this share of the largest part's are debris.
DEBRIS_SHARE = 0.05
