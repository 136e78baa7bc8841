#!/usr/bin/env python3
"""Cameras and times that `psfs calibrate --refine` estimates, beside the truth.

    scripts/measure_refinement.py SEQUENCE... [--every 2] [--seed 0] [--exact]

A sequence with `truth_calibration.toml` is taken as it is. Of others every camera is turned by 0.5
degrees, moved by 8 mm and refocused by 0.5 % (at random; not with --exact), and with `--every 2`
every second frame is used, of some cameras the odd ones, so that times differ by half a frame.
Prints: true joints apart, px, mean, given and corrected, after a similarity alignment where
the rig was spoilt; times apart without their mean, frames, worst and root mean square.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from scipy.optimize import least_squares

from cl import InputError, select_device
from psfs.cameras.calibration import read_calibration
from psfs.cameras.camera import CameraRig
from psfs.cli.commandline import add_device_flag, add_message_flags, stdout
from psfs.cli.program import run_command
from psfs.diagnostics.alignment import estimate_alignment, larger_views
from psfs.diagnostics.config import AlignmentConfig
from psfs.sequence import Sequence
from psfs.session import Session

_TURN, _SHIFT, _FOCAL = np.radians(0.5), 0.008, 0.005


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="measure_refinement.py", description=__doc__.splitlines()[0]
    )
    parser.add_argument("sequences", nargs="+", type=Path, metavar="SEQUENCE")
    parser.add_argument("--every", type=int, default=1, help="use every n-th frame")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--exact", action="store_true", help="do not spoil the cameras")
    add_device_flag(parser)
    add_message_flags(parser)
    parser.set_defaults(run=_run)
    return run_command(parser)


def _run(args: argparse.Namespace) -> None:
    for folder in args.sequences:
        stdout.print(f"{folder.name}: {_measure(folder, args)}", soft_wrap=True, markup=False)


def _measure(folder: Path, args: argparse.Namespace) -> str:
    config = AlignmentConfig()
    session = Session(Sequence.open(folder), select_device(args.device))
    given = true = session.rig
    starts = np.zeros(len(true), int)
    with np.load(folder / "truth.npz") as file:
        joints, late = file["joints"][::8].reshape(-1, 3), file.get("camera_offsets")
    own = (folder / "truth_calibration.toml").is_file()
    if own:
        true = read_calibration(folder / "truth_calibration.toml")
    elif not args.exact:
        given = spoil_rig(true, args.seed)
    if late is None:
        random = np.random.default_rng(100 + args.seed)
        starts = random.integers(0, args.every, len(true))
        late = starts / args.every
    views = larger_views(session, config)
    count = (len(views.outlines) - args.every + 1) // args.every
    outlines = [
        [views.outlines[args.every * frame + start][view] for view, start in enumerate(starts)]
        for frame in range(count)
    ]
    small = given.scaled(given.factor_within(config.longest_side))
    found = estimate_alignment(given, small, outlines, config)
    if found is None:
        raise InputError(f"{folder}: too few tips of limbs are seen by two cameras at once")
    apart = [measure_apart(rig, true, joints, align=not own) for rig in (given, found.rig)]
    wrong = found.corrections.offsets - late
    wrong -= wrong.mean()
    return (
        f"{'corrected' if found.is_accepted(config) else 'kept'}; silhouettes apart "
        f"{found.before:.2f}, {found.after:.2f} px; true joints {apart[0]:.2f}, {apart[1]:.2f} px; "
        f"times worst {np.abs(wrong).max():.3f}, rms {np.sqrt(np.mean(wrong**2)):.3f} frames"
    )


def spoil_rig(rig: CameraRig, seed: int) -> CameraRig:
    """Return the rig with every camera turned, moved and refocused at random."""
    random, cameras = np.random.default_rng(seed), []
    for camera in rig:
        turn, shift = (of / np.linalg.norm(of) for of in random.normal(size=(2, 3)))
        R, K = cv2.Rodrigues(_TURN * turn)[0] @ camera.R, camera.K.copy()
        K[[0, 0, 1], [0, 1, 1]] *= 1 + _FOCAL * random.choice([-1, 1])
        cameras.append(replace(camera, K=K, R=R, t=-R @ (camera.centre + _SHIFT * shift)))
    return CameraRig(tuple(cameras))


def measure_apart(found: CameraRig, true: CameraRig, points: np.ndarray, align: bool) -> float:
    """Return how far points (N, 3) are apart in both rigs' pictures, px, mean. align: after the
    similarity transform of the points that brings them nearest in the pictures found."""
    wanted = np.stack([camera.project(points)[0] for camera in true])

    def compare(values: np.ndarray) -> np.ndarray:
        moved = np.exp(values[6]) * points @ cv2.Rodrigues(values[:3])[0].T + values[3:6]
        return np.stack([camera.project(moved)[0] for camera in found]) - wanted

    values = np.zeros(7)
    if align:
        values = least_squares(lambda of: compare(of).ravel(), values, x_scale="jac").x
    return float(np.linalg.norm(compare(values), axis=-1).mean())


if __name__ == "__main__":
    sys.exit(main())
