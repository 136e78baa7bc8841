"""Twins of apf.synthetic and its kernels: what the cameras of the demo see."""
