"""Probabilistic shape from silhouette: calibrated views in, coloured voxel clouds out."""
