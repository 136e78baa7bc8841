"""Where a command's tracking starts: from what the flags state, else from what is found."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from apf.body import BodyModel, load_body
from apf.body.bodytrack import is_bodytrack, read_body
from apf.formats.trc import CONVENTIONS
from apf.initialisation import start_of
from apf.initialisation.automatic import Start
from apf.initialisation.from_joints import fit_to_joints, read_pose
from apf.results.evaluate import load_truth
from apf.results.joint_names import match_joints
from cl import Device, InputError, NumpyDevice
from psfs.cli.commandline import warn
from psfs.common.ranges import check_range
from psfs.sequence import Sequence
from psfs.voxels.grid import VoxelGrid


def add_start_flags(parser: argparse.ArgumentParser) -> None:
    """--body, --init, --height, --convention and --voxel-size."""
    parser.add_argument(
        "--body",
        metavar="B",
        help="body model: a TOML file or a shipped name (default: song31, or the sequence's own)",
    )
    parser.add_argument(
        "--init",
        type=Path,
        metavar="P",
        help="first pose: a text file with a value per degree of freedom (radians, metres), or "
        "joints (npz or TRC) to whose first frame body and pose are fitted "
        "(default: the sequence's own, where it has one; else found in the first voxels)",
    )
    parser.add_argument(
        "--height", type=float, metavar="M", help="stature of the person, m, if it is known"
    )
    parser.add_argument(
        "--convention", choices=CONVENTIONS, default="y-up", help="axes of a TRC (default: y-up)"
    )
    parser.add_argument("--voxel-size", type=float, metavar="M", help="edge of a voxel, m")


def check_height(args: argparse.Namespace) -> None:
    """Raise InputError for a --height that nobody has."""
    if args.height is not None:
        check_range("--height, m,", args.height, 0.5, 2.5, ends=True)


def first_pose(
    sequence: Sequence, frame: int, body_name: str | None, init: Path | None, convention: str
) -> tuple[BodyModel, np.ndarray] | None:
    """The body to track and its pose (D,) in the first `frame`, or None if there is none given.

    Raises InputError.
    """
    own = body_name is None and is_bodytrack(sequence.folder)
    body = read_body(sequence.folder) if own else load_body(body_name or "song31")
    if init is None:
        return (body, body.rest_pose) if own else None
    if init.suffix.lower() not in (".npz", ".trc"):
        return body, read_pose(init, body)
    truth = load_truth(init, convention)
    rows = np.flatnonzero(truth.frames == frame)
    if not rows.size:
        raise InputError(f"{init}: no joints for frame {frame}, the first to be tracked")
    joints = {
        name: truth.joints[rows[0], place]
        for name, place in match_joints(truth.joint_names).items()
    }
    body, pose, _ = fit_to_joints(body, joints)
    return body, pose


def template_of(args: argparse.Namespace) -> tuple[BodyModel, bool]:
    """The body whose size is to be found, and whether it, from a file, is the person's own."""
    own_shape = args.body is not None and Path(args.body).suffix == ".toml"
    return load_body(args.body or "song31"), own_shape


def found_start(
    device: Device | NumpyDevice,
    sequence: Sequence,
    grid: VoxelGrid,
    selection: slice,
    args: argparse.Namespace,
) -> tuple[BodyModel, np.ndarray]:
    """The body and its first pose (D,) found in the voxels; a body from a file keeps its shape."""
    template, own_shape = template_of(args)
    found = start_of(
        device,
        sequence,
        grid,
        template,
        selection,
        height=args.height,
        keep_shape=own_shape,
        seed=args.seed or 0,
    )
    tell_doubts(sequence, found)
    return found.body, found.pose


def tell_doubts(sequence: Sequence, start: Start) -> None:
    """Warn of what speaks against the start that was found."""
    for doubt in start.doubts:
        warn(f"{sequence.name}: {doubt}")
