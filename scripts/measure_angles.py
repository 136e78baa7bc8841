#!/usr/bin/env python3
"""Joint angles of tracks, and of OpenSim's inverse kinematics on them, against true rotations.

    scripts/measure_angles.py TRACKS SUITE -o OUT [--opensim PYTHON --osim-model FILE]
    scripts/measure_angles.py -o OUT --tables

TRACKS holds SEQUENCE.HOW.npz, such as synth_run_6cam.voxels.npz, tracks of sequences of SUITE whose
truth.npz has rotations. All are smoothed, as `apf export` does. --opensim is a Python that has
opensim: with it each track is exported as by `apf export --to osim`. Writes OUT/angles.json (every
track) and OUT/angles.md; --tables writes them again, and the table of docs/accuracy.md.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from timings.report.readme import replace_marked
from timings.results import checked_out_commit
from timings.tables.grid import NONE, Grid

from apf.evaluation.angle_truth import load_true_segments, measure_angle
from apf.formats.angles import coordinates_between, opensim_coordinates, pelvis_coordinates
from apf.formats.opensim.model import find_model, read_model
from apf.formats.opensim.setup import COORDINATES, write_setup
from apf.formats.opensim.tools import run_tools
from apf.tracking.smoothing import smooth_track
from apf.tracking.track import Track
from cl import InputError
from psfs.cli.commandline import add_message_flags, stderr
from psfs.cli.program import run_command
from psfs.common.files import write_atomically, write_json

_ROOT = Path(__file__).resolve().parent.parent
#: Rows of the table: angles by OpenSim's names, without their side.
_GROUPS = {
    "pelvis": ("pelvis_tilt", "pelvis_list", "pelvis_rotation"),
    "hip": ("hip_flexion", "hip_adduction", "hip_rotation"),
    "knee": ("knee_angle",),
    "trunk": ("lumbar_extension", "lumbar_bending", "lumbar_rotation"),
    "neck": ("neck_flexion", "neck_bending", "neck_rotation"),
    "shoulder": ("arm_flex", "arm_add", "arm_rot"),
    "elbow": ("elbow_flex",),
}
_LEGS = ("hip", "knee")


def main() -> int:
    parser = argparse.ArgumentParser(prog="measure_angles.py", description=__doc__.splitlines()[0])
    parser.add_argument("tracks", nargs="?", type=Path, metavar="TRACKS")
    parser.add_argument("suites", nargs="*", type=Path, metavar="SUITE")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="OUT")
    parser.add_argument("--opensim", type=Path, metavar="PYTHON", help="one that has opensim")
    parser.add_argument("--osim-model", type=Path, metavar="FILE", help="by default Pose2Sim's")
    parser.add_argument("--tables", action="store_true", help="of the results in OUT, and in docs")
    parser.add_argument("--device", default="", help="on which the tracks were made")
    parser.add_argument("--commit", help="of the tracks, where there is no git to ask")
    add_message_flags(parser)
    parser.set_defaults(run=_run, overwrite=True)  # its own tables, in any checkout
    return run_command(parser)


def _run(args: argparse.Namespace) -> None:
    path = args.out / "angles.json"
    if args.tables:
        if not path.is_file():
            raise InputError(f"{path}: not there; expected results of measure_angles.py")
        results = json.loads(path.read_text())
    else:
        results = _measure_all(args)
        write_json(path, results)
    tables = f"{joint_table(results).markdown()}\n\n{sequence_table(results).markdown()}"
    with write_atomically(args.out / "angles.md") as temporary:
        temporary.write_text(f"# Joint angles against true rotations\n\n{tables}\n")
    if args.tables:
        shown = f"{joint_table(results).markdown()}"
        replace_marked(_ROOT / "docs" / "accuracy.md", "angles", shown)
    joint_table(results).show()
    sequence_table(results).show()


def _measure_all(args: argparse.Namespace) -> dict[str, Any]:
    if args.tracks is None or not args.suites:
        raise InputError("no TRACKS and SUITE; expected both, or --tables")
    rows = []
    for path in sorted(args.tracks.glob("*.npz")):
        sequence, _, how = path.stem.partition(".")
        found = [suite / sequence / "truth.npz" for suite in args.suites]
        truth = next((file for file in found if file.is_file()), None)
        if truth is None:
            raise InputError(f"{path}: no {sequence}/truth.npz in the suites")
        stderr.print(f"{sequence}, {how}", soft_wrap=True)
        rows.append({"sequence": sequence, "by": how} | measure_track(path, truth, args))
    return {
        "made": date.today().isoformat(), "commit": args.commit or checked_out_commit(),
        "device": args.device, "tracks": rows,
    }  # fmt: skip


def measure_track(path: Path, truth: Path, args: argparse.Namespace) -> dict[str, Any]:
    """Return the errors of a track's angles, [RMS, RMS without the mean offset] in degrees by name,
    ours and OpenSim's."""
    known = load_true_segments(truth)
    if known is None:
        raise InputError(f"{truth}: no bone_rotations; expected true rotations")
    frames, segments = known
    true = pelvis_coordinates(segments["pelvis"]) | coordinates_between(segments)
    track = smooth_track(Track.open(path))
    _, rows, true_rows = np.intersect1d(track.frames, frames, return_indices=True)
    tables = {"ours": opensim_coordinates(track.its_body, track.poses)}
    if args.opensim is not None:
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch)
            write_setup(folder, track.motion, read_model(find_model(args.osim_model)))
            _, angles = run_tools(folder, args.opensim)
            tables["opensim"] = read_mot(angles)
    found: dict[str, Any] = {}
    for kind, table in tables.items():
        errors = {}
        for name, values in true.items():
            own = table.get(name, table.get(COORDINATES.get(name, name)))
            if own is not None and (e := measure_angle(name, own[rows], values[true_rows])):
                errors[name] = [round(e.rms, 3), round(e.free, 3)]
        found[kind] = errors
    return found


def read_mot(path: Path) -> dict[str, np.ndarray]:
    """Return the columns (F,) of a MOT file by name."""
    lines = path.read_text().splitlines()
    head = lines.index("endheader") + 1
    table = np.array([line.split() for line in lines[head + 1 :] if line.strip()], float)
    return dict(zip(lines[head].split(), table.T, strict=True))


def _mean(rows: list[dict[str, Any]], kind: str, groups: tuple[str, ...]) -> np.ndarray | None:
    """Return (2,) degrees, the mean over tracks, sides and the angles of groups."""
    names = [name for group in groups for name in _GROUPS[group]]
    pairs = [
        pair for row in rows for name, pair in row.get(kind, {}).items()
        if name.removesuffix("_l").removesuffix("_r") in names
    ]  # fmt: skip
    return np.mean(pairs, axis=0) if pairs else None


def _cells(rows: list[dict[str, Any]], hows: list[str], groups: tuple[str, ...]) -> list[str]:
    cells = []
    for how in hows:
        for kind in ("ours", "opensim"):
            mean = _mean([row for row in rows if row["by"] == how], kind, groups)
            cells.append(NONE if mean is None else f"{mean[0]:.1f} / {mean[1]:.1f}")
    return cells


def _heads(hows: list[str]) -> list[str]:
    return [f"{how}: {kind}" for how in hows for kind in ("ours", "OpenSim")]


def _hows(results: dict[str, Any]) -> list[str]:
    return list(dict.fromkeys(sorted((row["by"] for row in results["tracks"]), reverse=True)))


def joint_table(results: dict[str, Any]) -> Grid:
    """Return a row per joint: means over sequences, sides and the joint's angles."""
    hows, rows = _hows(results), results["tracks"]
    shown = [[name, *_cells(rows, hows, (name,))] for name in _GROUPS]
    shown.append(["hip and knee", *_cells(rows, hows, _LEGS)])
    shown.append(["all", *_cells(rows, hows, tuple(_GROUPS))])
    counts = [f"{how} {sum(row['by'] == how for row in rows)}" for how in hows]
    about = (
        f"Sequences: {', '.join(counts)}; seed 0; {results['device']}, {results['made']}, commit "
        f"{results['commit']}. Angles as in motion.mot; those of a "
        "shoulder have a pole where the arm is level at the side."
    )
    heads = ["joint", *_heads(hows)]
    return Grid("Joint angles, degrees: RMS / without the mean offset", heads, shown, about)


def sequence_table(results: dict[str, Any]) -> Grid:
    """Return a row per sequence: means over hips and knees, and over all angles."""
    hows, shown = _hows(results), []
    for name in sorted({row["sequence"] for row in results["tracks"]}):
        rows = [row for row in results["tracks"] if row["sequence"] == name]
        legs, every = _cells(rows, hows, _LEGS), _cells(rows, hows, tuple(_GROUPS))
        shown.append([name, *(f"{a}; {b}" for a, b in zip(legs, every, strict=True))])
    title = "By sequence: hip and knee; all, degrees"
    return Grid(title, ["sequence", *_heads(hows)], shown)


if __name__ == "__main__":
    sys.exit(main())
