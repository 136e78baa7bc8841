"""Where a command's tracking starts: from what the flags state, else from what is found."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from apf.api import template_of
from apf.body import BodyModel
from apf.formats.trc import CONVENTIONS
from apf.initialisation import Start, StartError, initialise
from cl import InputError
from psfs.cli.commandline import path_or_name, warn
from psfs.cli.sequence_flags import voxel_edge
from psfs.cli.settings import refuse_unused
from psfs.common.ranges import check_range
from psfs.sequence import Sequence
from psfs.session import Session


def add_start_flags(parser: argparse.ArgumentParser) -> None:
    """--body, --init, --height, --convention and --voxel-size."""
    group = parser.add_argument_group("start", "who is tracked, and from where")
    group.add_argument(
        "--body",
        type=path_or_name,
        metavar="B",
        help="body model: a TOML file or a shipped name (default: song31, or the sequence's own)",
    )
    group.add_argument(
        "--init",
        type=Path,
        metavar="P",
        help="first pose: a text file with a value per degree of freedom (radians, metres), or "
        "joints (npz or TRC) to whose first frame body and pose are fitted "
        "(default: the sequence's own, where it has one; else found in the first voxels)",
    )
    group.add_argument(
        "--height", type=float, metavar="M", help="stature of the person, m, if it is known"
    )
    group.add_argument(
        "--convention", choices=CONVENTIONS, default="y-up", help="axes of a TRC (default: y-up)"
    )
    group.add_argument("--voxel-size", type=voxel_edge, metavar="M", help="edge of a voxel, m")


def check_start(args: argparse.Namespace) -> None:
    """Raise InputError for a --height that nobody has, and for flags that nothing takes."""
    if args.init is not None:
        refuse_unused(args, ["height"], "is of a start that is found; expected none with --init")
    joints = [path for path in (args.init, getattr(args, "truth", None)) if path is not None]
    if not any(path.suffix.lower() == ".trc" for path in joints):
        refuse_unused(args, ["convention"], "is of a TRC; expected one as --init with it")
    if args.height is not None:
        check_range("--height, m,", args.height, 0.5, 2.5, ends=True)


def found_start(
    session: Session, args: argparse.Namespace, seed: int, progress: Callable[[], object] | None
) -> tuple[BodyModel, np.ndarray]:
    """Return the body and its first pose (D,) found in the voxels; a body from a file keeps its
    shape."""
    template, keep_shape = template_of(args.body)
    with naming_init(session.sequence):
        found = initialise(
            session, template, height=args.height, keep_shape=keep_shape, seed=seed,
            progress=progress,
        )  # fmt: skip
    warn_of_doubts(session.sequence, found)
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
