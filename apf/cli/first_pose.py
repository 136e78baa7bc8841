"""The start of a command's tracking: stated by the flags, or else found automatically."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from apf.api import load_template
from apf.body import BodyModel
from apf.initialisation import Start, StartError, initialise
from psfs.cli.commandline import warn
from psfs.cli.settings import refuse_unused
from psfs.common.ranges import check_number
from psfs.sequence import Sequence
from psfs.session import Session


def check_start(args: argparse.Namespace) -> None:
    """Raise InputError for an impossible --height, and for flags that have no effect."""
    if args.init is not None:
        refuse_unused(
            args, ["height"], "applies only to an automatic start; expected none with --init"
        )
    joints = [path for path in (args.init, getattr(args, "truth", None)) if path is not None]
    if not any(path.suffix.lower() == ".trc" for path in joints):
        refuse_unused(args, ["convention"], "applies only to a TRC; expected one as --init with it")
    if args.height is not None:
        check_number("--height, m,", args.height, 0.5, 2.5)


def find_first_pose(
    session: Session,
    args: argparse.Namespace,
    seed: int,
    progress: Callable[[], object] | None,
    number: int | None = None,
) -> tuple[BodyModel, np.ndarray]:
    """Return the body and its first pose (D,) found in the voxels; a body from a file keeps its
    shape. number: of one of several people, counted from 1, for messages."""
    template, keep_shape = load_template(args.body)
    with explain_failed_start(session.sequence, number):
        found = initialise(
            session, template, height=args.height, keep_shape=keep_shape, seed=seed,
            progress=progress,
        )  # fmt: skip
    warn_of_doubts(session.sequence, found, number)
    return found.body, found.pose


@contextmanager
def explain_failed_start(sequence: Sequence, number: int | None = None) -> Iterator[None]:
    """Add to the error of a failed start the name of the sequence, the number of one of several
    people, and the flags that help."""
    try:
        yield
    except StartError as error:
        instead = "; --frames a: begins at another frame"
        if number is None:  # --init is of one person
            instead += ", --init gives a first pose instead"
        raise StartError(f"{_name(sequence, number)}: {error}{instead}") from None


def warn_of_doubts(sequence: Sequence, start: Start, number: int | None = None) -> None:
    """Log the doubts about an automatic start as warnings; number: of one of several people."""
    instead = ", or give --init" if number is None else ""
    for doubt in start.doubts:
        warn(f"{_name(sequence, number)}: {doubt}; look at the overlay{instead}")


def _name(sequence: Sequence, number: int | None) -> str:
    return sequence.name if number is None else f"{sequence.name}, person{number}"
