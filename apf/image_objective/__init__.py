"""Objectives over image features: silhouettes and edges, compared with rendered bodies.

Kwolek & Rymut 2016; Rymut 2016, chapters 2, 4 and 5.
"""
