"""Twins of apf.image_objective and its kernels: features, rendering, objectives."""
