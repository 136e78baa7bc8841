"""The annealed particle filter: a 31-degree-of-freedom skeleton from voxel clouds."""
