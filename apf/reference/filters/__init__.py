"""Twins of apf.filters and their kernels: the searches, step by step."""
