"""Where a command's tracking starts: from what the flags state, else from what is found."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from apf.api import template_of
from apf.body import BodyModel
from apf.initialisation import Start, StartError, start_of
from cl import Device, InputError, NumpyDevice
from psfs.cli.commandline import warn
from psfs.cli.settings import refuse_unused
from psfs.common.ranges import check_number
from psfs.sequence import Sequence
from psfs.voxels.grid import VoxelGrid


def check_start(args: argparse.Namespace) -> None:
    """Raise InputError for a --height that nobody has, and for flags that nothing takes."""
    if args.init is not None:
        refuse_unused(args, ["height"], "is of a start that is found; expected none with --init")
    joints = [path for path in (args.init, getattr(args, "truth", None)) if path is not None]
    if not any(path.suffix.lower() == ".trc" for path in joints):
        refuse_unused(args, ["convention"], "is of a TRC; expected one as --init with it")
    if args.height is not None:
        check_number("--height, m,", args.height, 0.5, 2.5)


def found_start(
    device: Device | NumpyDevice,
    sequence: Sequence,
    grid: VoxelGrid,
    selection: slice,
    args: argparse.Namespace,
    seed: int,
) -> tuple[BodyModel, np.ndarray]:
    """The body and its first pose (D,) found in the voxels; a body from a file keeps its shape."""
    template, own_shape = template_of(args.body)
    with naming_init(sequence):
        found = start_of(
            device, sequence, grid, template, selection,
            height=args.height, keep_shape=own_shape, seed=seed,
        )  # fmt: skip
    warn_of_doubts(sequence, found)
    return found.body, found.pose


@contextmanager
def naming_init(sequence: Sequence) -> Iterator[None]:
    """Add to the error of a start that was not found the sequence, and the flags that mend it."""
    try:
        yield
    except StartError as error:
        raise InputError(
            f"{sequence.name}: {error}; --frames a: begins at another frame, --init gives a first "
            "pose instead"
        ) from None


def warn_of_doubts(sequence: Sequence, start: Start) -> None:
    """Warn of what speaks against the start that was found."""
    for doubt in start.doubts:
        warn(f"{sequence.name}: {doubt}; look at the overlay, or give --init")
