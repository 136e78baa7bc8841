"""Twins of apf.likelihood and its kernels: the errors of poses against voxels."""
