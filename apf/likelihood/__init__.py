"""Errors of poses against the voxels: Song et al. eq. (14)-(16), and further terms."""
