"""NumPy twins of the kernels, in float64: the specification they are tested against."""
