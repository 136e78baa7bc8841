"""Track many takes on many workers.

Dask runs the tasks; this package sets up the workers, records which takes are finished, and writes
their overview page.
"""
