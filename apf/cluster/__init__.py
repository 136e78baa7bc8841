"""Track many takes on many workers.

Processes of this machine or a Dask cluster run the tasks; this package sets up the workers, records
which takes are finished, and writes their overview page.
"""

#: Most workers of a GPU, which a take leaves idle while its host decodes and fits: on an H200 with
#: 16 cores 2 did 24 takes per minute, 4 41 and 8 70 (docs/cluster.md); each keeps two cores busy.
PER_GPU, CORES_BESIDE_GPU = 8, 2
