"""Bounds and defaults of voxel flags, shared by several commands."""

from __future__ import annotations

#: Edges of voxels, least and greatest, m.
VOXEL_EDGES = (1e-6, 100.0)
#: Parts of a cloud are debris if they have fewer voxels than this share of the largest part's.
DEBRIS_SHARE = 0.05
