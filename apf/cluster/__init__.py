"""Many takes on many workers: Dask carries the tasks, this room says what a worker is, when a take
is finished, and what the lab sees of it."""
