"""`apf keypoints`: detect 2-D keypoints in all cameras with a pose network."""

from __future__ import annotations

import argparse
from contextlib import closing
from pathlib import Path

import numpy as np

from apf.keypoints.estimation import EstimationJob, estimate_keypoints, write_openpose
from apf.keypoints.network import check_network
from cl import InputError
from psfs.cli.commandline import progress_bar, stdout, warn
from psfs.cli.sequence_flags import collect_overrides, open_sequence
from psfs.cli.settings import FILE, write_settings
from psfs.common.outputs import output_folder
from psfs.sequence import Sequence

#: Least share of a camera's frames with a detected person; below it a warning is logged.
_SELDOM = 0.8


def run(args: argparse.Namespace) -> None:
    if args.at_once is not None and args.at_once < 1:
        raise InputError(f"--at-once is {args.at_once}; expected at least 1")
    check_network()
    sequence = open_sequence(args)
    pattern = "*_json/*_[0-9][0-9][0-9][0-9][0-9][0-9].json"
    with output_folder(args.output, args.parser.prog, sequence.inputs, (pattern, FILE)):
        found = _detect(args, sequence)
        write_settings(args.output, args)
    for camera, frames in found.items():
        if frames < _SELDOM * len(sequence):
            warn(f"{camera}: a person was found in {frames} of {len(sequence)} frames only")
    stdout.print(
        f"{len(sequence)} frames x {len(sequence.rig)} cameras: {args.output}", soft_wrap=True
    )


def _detect(args: argparse.Namespace, sequence: Sequence) -> dict[str, int]:
    """Write the keypoints of each camera as soon as it is done; return the number of its frames in
    which the person was found."""
    crop = sequence.empty_scene and not args.no_crop
    job = EstimationJob(Path(args.folder), collect_overrides(args), args.device if crop else None)
    bar = progress_bar()
    task = bar.add_task("keypoints", total=len(sequence) * len(sequence.rig))

    def show(done: int) -> None:
        if done:  # not before: an error must stay a single line
            bar.start()
        bar.update(task, completed=done)

    found = {}
    try:
        with closing(estimate_keypoints(job, args.at_once, show)) as cameras:
            for camera, points in cameras:
                write_openpose(args.output / f"{camera}_json", camera, points)
                found[camera] = int(np.isfinite(points).any((1, 2)).sum())
    finally:
        if bar.live.is_started:
            bar.stop()
    return found
