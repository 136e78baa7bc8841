#!/usr/bin/env python3
"""What wrong and missing keypoints cost a track.

    scripts/spoil_keypoints.py FOLDER [FOLDER ...] --alone

takes sequences with truth.npz and keypoints, and prints the mean error, mm, over shoulders, elbows,
wrists, hips, knees and ankles by keypoints as they are, with a fifth of them at random places, with
left and right exchanged in one camera, and with one camera without any; beside it triangulation's.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.table import Table

from apf.api import DEFAULT_BODY
from apf.body import load_body
from apf.evaluation.evaluate import evaluate, load_truth
from apf.filters.method import Method
from apf.formats.trc import JointSeries
from apf.keypoints import Keypoints, locate_points
from apf.tracking.settings import TakeSettings
from apf.tracking.take import track_take
from apf.tracking.track import Track
from apf.tracking.triangulated import TriangulatedConfig, triangulate_track
from cl import select_device
from psfs.cli.commandline import add_message_flags, stdout
from psfs.cli.program import run_command
from psfs.common.ranges import check_number
from psfs.sequence import Sequence
from psfs.session import Session

KINDS = ("clean", "outliers", "exchanged", "missing")
_LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")


def main() -> int:
    parser = argparse.ArgumentParser(prog="spoil_keypoints.py", description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("--alone", action="store_true", help="keypoints alone, without voxels")
    parser.add_argument("--camera", type=int, default=1, metavar="N", help="the spoilt one (1)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="auto")
    add_message_flags(parser)
    parser.set_defaults(run=_run)
    return run_command(parser)


def spoilt(keypoints: Keypoints, kind: str, camera: int, seed: int = 0) -> Keypoints:
    """Return the keypoints spoilt in one of the ways `KINDS`."""
    points = keypoints.points.copy()
    if kind == "outliers":
        random = np.random.default_rng(seed)
        low, high = (of(points[..., :2], (0, 1, 2)) for of in (np.nanmin, np.nanmax))
        wrong = random.random(points.shape[:3]) < 0.2
        places = random.uniform(low, high, (*points.shape[:3], 2))
        points[..., :2] = np.where(wrong[..., None], places, points[..., :2])
    elif kind == "exchanged":
        own = locate_points(load_body(DEFAULT_BODY), keypoints.names)
        points[camera][:, own.columns] = points[camera][:, own.columns[own.partners]]
    elif kind == "missing":
        points[camera] = np.nan
    return replace(keypoints, points=points)


def _run(args: argparse.Namespace) -> None:
    device = select_device(args.device)
    objective = "keypoints" if args.alone else "voxel"
    table = Table("sequence", "keypoints", "triangulation", "tracked", "of clean")
    for folder in args.folders:
        sequence, truth = Sequence.open(folder), load_truth(folder / "truth.npz")
        check_number("--camera", args.camera, 0, len(sequence.rig) - 1)
        keypoints, clean = Keypoints.open(folder, sequence), np.nan
        for kind in KINDS:
            seen = spoilt(keypoints, kind, args.camera, args.seed)
            without = triangulate_track(sequence, seen, TriangulatedConfig(low_pass=6.0))
            method = Method.create(objective=objective, seed=args.seed)
            settings = TakeSettings(method=method, keypoints=seen)
            take = track_take(Session(sequence, device), settings)
            found = [_limb_error(track, truth) for track in (without, take.tracks[0])]
            clean = found[1] if kind == "clean" else clean
            figures = *(f"{error:.1f}" for error in found), f"{found[1] / clean:.2f}"
            table.add_row(folder.name, kind, *figures)
    stdout.print(table)


def _limb_error(track: Track, truth: JointSeries) -> float:
    """Return the mean error, mm, over frames and the joints that keypoints have, too."""
    found = evaluate(track, truth)
    limbs = [k for k, name in enumerate(found.joint_names) if name[2:] in _LIMBS]
    return 1000 * float(np.nanmean(found.errors[:, limbs]))


if __name__ == "__main__":
    sys.exit(main())
