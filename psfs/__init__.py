"""Probabilistic shape from silhouette: calibrated views in, a coloured voxel cloud per frame out."""
