#!/usr/bin/env python3
"""What smoothing does to tracks whose truth is known: error, jitter, sliding of standing feet.

    scripts/compare_smoothing.py OUT/a=a/truth.npz OUT/b=b/truth.trc --convention pose2sim

takes folders of `apf track`, not smoothed, and prints of each, as tracked, smoothed, and smoothed
with feet held: the mean error, mm; the wrists' mean second difference, mm/frame^2; and the greatest
distance, mm, that an ankle moves along the floor in any stance. Stances are those of the truth
where it has ankles and toes: frames in which both of a foot are slower than 0.3 m/s and its ankle
is low; else those that smoothing found.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from peers.figures import find_true_stances, measure_travels
from rich.table import Table

from apf.evaluation.evaluate import evaluate, load_truth
from apf.formats.trc import CONVENTIONS, JointSeries
from apf.tracking.smoothing import SmoothingConfig, smooth_track
from apf.tracking.track import Track
from cl import InputError
from psfs.cli.commandline import add_message_flags, stdout
from psfs.cli.program import run_command

_SIDES = ("l", "r")


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="compare_smoothing.py", description=__doc__.splitlines()[0]
    )
    parser.add_argument("tracks", nargs="+", metavar="OUT=TRUTH")
    parser.add_argument(
        "--convention", choices=tuple(CONVENTIONS), default="y-up", help="axes of a TRC"
    )
    parser.add_argument("--cutoff", type=float, default=SmoothingConfig().cutoff, metavar="HZ")
    add_message_flags(parser)
    parser.set_defaults(run=_run)
    return run_command(parser)


def _run(args: argparse.Namespace) -> None:
    table = Table("track", "poses", "error", "wrists' jitter", "stances", "travel")
    for pair in args.tracks:
        folder, separator, file = pair.partition("=")
        if not separator:
            raise InputError(f"{pair}: expected OUT=TRUTH")
        track, truth = Track.open(folder), load_truth(file, args.convention)
        for poses, shown in variants(track, args.cutoff).items():
            stands = true_stances(truth, track)
            if stands is None:
                stands = smooth_track(track, SmoothingConfig(cutoff=args.cutoff)).standing
            travels = measure_travels(shown.series, stands)
            error = 1000 * evaluate(shown, truth).mean_error
            figures = (
                f"{error:.2f}",
                f"{jitter(shown):.2f}",
                f"{len(travels)}",
                f"{max(travels, default=0.0):.1f}",
            )
            table.add_row(Path(folder).name, poses, *figures)
    stdout.print(table)


def variants(track: Track, cutoff: float) -> dict[str, Track]:
    """Return the track as it is, smoothed, and smoothed with feet held."""
    return {
        "as tracked": track,
        "smoothed": smooth_track(track, SmoothingConfig(cutoff=cutoff, contact=None)),
        "feet held": smooth_track(track, SmoothingConfig(cutoff=cutoff)),
    }


def jitter(track: Track) -> float:
    """Return the wrists' mean second difference, mm/frame^2, of the worse one."""
    wrists = [track.joint_names.index(f"{side}_wrist") for side in _SIDES]
    second = np.diff(track.joints[:, wrists], 2, axis=0)
    return float(1000 * np.linalg.norm(second, axis=-1).mean(0).max())


def true_stances(truth: JointSeries, track: Track) -> np.ndarray | None:
    """Return (F, 2) bool: where the true feet stand in the frames of `track`; None if the truth
    lacks ankles or toes."""
    still = find_true_stances(truth)
    if still is None:
        return None
    shared = np.isin(track.frames, truth.frames)
    found = np.zeros((len(track), 2), bool)
    found[shared] = still[np.searchsorted(truth.frames, track.frames[shared])]
    return found


if __name__ == "__main__":
    sys.exit(main())
