"""The NumPy twins: plain, float64, the specification of the kernels; in the rooms of what they
are twins of."""
