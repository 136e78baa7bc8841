"""How finely frusta are drawn."""

#: Vertices per part of the frusta of table 6.5: a square base, then elliptic ones.
FRUSTUM_VERTICES = (8, 18, 34, 66, 130, 258, 514)
