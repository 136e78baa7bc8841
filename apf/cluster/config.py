"""Settings of batches: chunks of long takes, and workers."""

from __future__ import annotations

from psfs.common.config import Config, natural, nonnegative, positive


class ChunksConfig(Config):
    """Overlap of chunks, and when they agree."""

    overlap: float = nonnegative(
        1.0,
        "Time that two chunks share.",
        "a track has settled on a start that was found within about half",
        "s",
    )
    agreement: float = positive(
        0.05,
        "Mean distance over the joints up to which two tracks of a frame are the same but for "
        "noise.",
        "runs with different seeds lie about 10 to 20 mm apart, a wrong start 100 and more",
        "m",
    )


class WorkerConfig(Config):
    """Number of workers of an embedded cluster. A worker is a process that does one take at a
    time."""

    per_gpu: int = natural(
        8,
        "Greatest number of workers of a GPU: a take leaves it idle while its host decodes and "
        "fits; contexts on one GPU take turns.",
        "on an H200 with 16 cores 2 did 24 takes per minute, 4 41 and 8 70, see docs/cluster.md",
    )
    beside_gpu: float = positive(
        2.0,
        "Number of cores for each worker of a GPU.",
        "number of cores that one take keeps busy with decoding and waiting",
    )
    cores: int = natural(
        1,
        "Number of cores of a worker that computes on the CPU.",
        "by hand: a take's decoding and start use one core",
    )
