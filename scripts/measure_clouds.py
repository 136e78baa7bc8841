#!/usr/bin/env python3
"""Clouds beside what true silhouettes would make of them: IoU with the true masks, and time.

    scripts/measure_clouds.py FOLDER... -o RESULTS.json [--other NAME=SETTINGS.json] [--tracks DIR]

reconstructs each sequence that has true masks with the default settings and with each `--other`
ones (a JSON of `reconstruction`, laid over the defaults), writes all figures, and prints a table.
With `--tracks`, a folder with a track of each sequence, all reconstruct with the tracked body.
Of sequences of `apf synth` the distances to the true surface are written, too (`true_surface.py`).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table
from true_surface import open_true_surface, score_surface

from cl import Device, InputError, select_device
from psfs.cli.commandline import add_device_flag, add_message_flags, stdout
from psfs.cli.program import run_command
from psfs.common.files import write_json
from psfs.diagnostics.cloud_scores import DEFINITION, mean_scores, score_cloud
from psfs.diagnostics.examination import examine
from psfs.diagnostics.silhouette_scores import score_silhouettes, truth_frames
from psfs.sequence import Sequence
from psfs.session import Session, SessionSettings
from psfs.volume import automatic_grid
from psfs.voxels.body_prior import TrackedBody
from psfs.voxels.config import ReconstructionConfig
from psfs.voxels.grid import VoxelGrid

#: The name of the default settings in the results.
_DEFAULT = "default"
#: Frames that are timed, one after the other with all settings in turns, and rounds of them.
_TIMED, _ROUNDS = 6, 4


def main() -> int:
    parser = argparse.ArgumentParser(prog="measure_clouds.py", description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path, metavar="FOLDER")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="RESULTS.json")
    parser.add_argument("--other", action="append", default=[], metavar="NAME=SETTINGS.json")
    parser.add_argument("--tracks", type=Path, metavar="DIR")
    add_device_flag(parser)
    add_message_flags(parser)
    parser.set_defaults(run=_run)
    return run_command(parser)


def _run(args: argparse.Namespace) -> None:
    configs = {_DEFAULT: ReconstructionConfig()}
    for pair in args.other:
        name, separator, file = pair.partition("=")
        if not separator:
            raise InputError(f"{pair}: expected NAME=SETTINGS.json")
        configs[name] = ReconstructionConfig.from_dict(json.loads(Path(file).read_text()), file)
    device = select_device(args.device)
    rows: dict[str, Any] = {}
    for folder in args.folders:
        body = None if args.tracks is None else TrackedBody.open(args.tracks / folder.name)
        rows[folder.name] = measure_sequence(device, folder, configs, body)
        write_json(
            args.output, {"definition": DEFINITION, "device": device.name, "sequences": rows}
        )
    stdout.print(_table(rows))


def measure_sequence(
    device: Any, folder: Path, configs: dict[str, ReconstructionConfig], body: TrackedBody | None
) -> dict[str, Any]:
    """Return the figures of a sequence by the name of the settings."""
    sequence = Sequence.open(folder)
    session = examine(Session(sequence, device, SessionSettings())).session
    wanted, grid = truth_frames(session.sequence), automatic_grid(session)
    if not wanted:
        raise InputError(f"{folder}: has no true masks; expected some in truth_masks/")
    found: dict[str, Any] = {}
    surface_of = open_true_surface(folder, device) if isinstance(device, Device) else None
    for name, config in configs.items():
        own = Session(session.sequence, device, SessionSettings(config))
        silhouettes, clouds, voxels, surfaces = [], [], [], []
        for shown in score_silhouettes(own, wanted, grid, body):
            if shown is not None:
                silhouettes.append(shown.scores[:, 0])
                clouds.append(score_cloud(session.rig, shown.cloud, shown.truth))
                voxels.append(len(shown.cloud))
                if surface_of is not None:
                    surfaces.append(score_surface(shown.cloud, surface_of(shown.frame.index)))
        found[name] = {"silhouettes": float(np.nanmean(silhouettes)), **mean_scores(clouds)}
        found[name]["surface_voxels"] = float(np.median(voxels))
        for key in surfaces[0] if surfaces else ():
            found[name][key] = float(np.mean([of[key] for of in surfaces]))
    for name, ms in _times(device, session.sequence, grid, configs, body).items():
        found[name]["ms"] = ms
    return found


def _times(
    device: Any,
    sequence: Sequence,
    grid: VoxelGrid,
    configs: dict[str, ReconstructionConfig],
    body: TrackedBody | None,
) -> dict[str, float]:
    """Return the median time, ms, of a reconstructed frame with each of the settings, measured in
    turns."""
    shown = sequence.frames(slice(_TIMED))
    frames = [replace(f, images=None if f.images is None else f.images.copy()) for f in shown]
    made = {
        name: Session(sequence, device, SessionSettings(config)).reconstructor(grid, body)
        for name, config in configs.items()
    }
    times: dict[str, list[float]] = {name: [] for name in configs}
    for round_ in range(_ROUNDS):
        for name, reconstruct in made.items():
            for number, frame in enumerate(frames):
                began = time.perf_counter()
                reconstruct(frame)
                if isinstance(device, Device):
                    device.finish()
                if round_ and number:  # the first of a round is worked on again
                    times[name].append(1e3 * (time.perf_counter() - began))
    return {name: round(float(np.median(ms)), 4) for name, ms in times.items()}


def _table(rows: dict[str, Any]) -> Table:
    table = Table(
        *("sequence", "settings", "silhouettes", "cloud", "ceiling", "share", "ghosts"),
        *("volume", "ms"),
    )
    for sequence, by_name in rows.items():
        for name, of in by_name.items():
            scores = [of["silhouettes"], of["iou"], of["ceiling"], of["iou"] / of["ceiling"]]
            cells = [f"{score:.3f}" for score in scores]
            cells += [f"{of['ghosts']:.2%}", f"{of['volume']:.3f}", f"{of['ms']:.2f}"]
            table.add_row(sequence, name, *cells)
    return table


if __name__ == "__main__":
    sys.exit(main())
