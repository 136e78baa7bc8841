"""The NumPy twins: plain, float64, the specification of the kernels of the same names."""
