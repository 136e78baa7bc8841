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
import warnings
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from timings.report.readme import replace_marked
from timings.results import checked_out_commit
from timings.tables.grid import NONE, Grid

from apf.body.angles import decompose_yxy
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
from psfs.common.files import write_json, write_text

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
#: Rows of a shoulder's angles after the International Society of Biomechanics, in the frames in
#: which they can be seen, and of the upper arm's direction, which has no pole.
_SHOULDER = {
    "shoulder: elevation": "elevation",
    "shoulder: plane of elevation, arm raised": "plane",
    "shoulder: axial rotation, and elbow bent": "axial",
    "upper arm's direction": "direction",
}
#: Elevations, degrees, between which a raised arm is, and least flexion of a bent elbow: the plane
#: of a hanging arm is undefined, and no surface shows how a straight arm is turned about itself.
_RAISED, _BENT = (30.0, 150.0), 30.0


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
    write_text(args.out / "angles.md", f"# Joint angles against true rotations\n\n{tables}\n")
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
    seen = {name: values[true_rows] for name, values in true.items()}
    for kind, table in tables.items():
        own = {name: table.get(name, table.get(COORDINATES.get(name, name))) for name in seen}
        own = {name: values[rows] for name, values in own.items() if values is not None}
        errors = measure_shoulders(own, seen)
        for name, values in own.items():
            if e := measure_angle(name, values, seen[name]):
                errors[name] = [round(e.rms, 3), round(e.free, 3)]
        found[kind] = errors
    return found


def measure_shoulders(
    own: dict[str, np.ndarray], true: dict[str, np.ndarray]
) -> dict[str, list[float]]:
    """Return the errors, as `measure_track` does, of the angles of `_SHOULDER` by name and side.

    own, true: OpenSim's coordinates (F,), degrees, by name. A direction's error is the angle
    between both, in the trunk; without its offset: after the constant rotation that fits best.
    """
    found = {}
    for side in "lr":
        names = [f"{name}_{side}" for name in _GROUPS["shoulder"]]
        if not {*names, f"elbow_flex_{side}"} <= set(own) & set(true):
            continue
        ours, theirs = (
            Rotation.from_euler("ZXY", np.stack([of[name] for name in names], -1), degrees=True)
            for of in (own, true)
        )
        turned, truly = (np.degrees(decompose_yxy(of.as_matrix())) for of in (ours, theirs))
        raised = (truly[:, 1] > _RAISED[0]) & (truly[:, 1] < _RAISED[1])
        bent = raised & (true[f"elbow_flex_{side}"] > _BENT)
        for column, name, where in (
            (0, "plane", raised),
            (1, "elevation", True),
            (2, "axial", bent),
        ):
            shown = np.where(where, turned[:, column], np.nan)
            if e := measure_angle(name, shown, truly[:, column]):
                found[f"{name}_{side}"] = [round(e.rms, 3), round(e.free, 3)]
        directions = [of.apply([0.0, 1, 0]) for of in (ours, theirs)]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of an arm that never moves: any rotation will do
            constant, _ = Rotation.align_vectors(directions[1], directions[0])
        off = (
            _mean_angle(of, directions[1]) for of in (directions[0], constant.apply(directions[0]))
        )
        found[f"direction_{side}"] = [round(angle, 3) for angle in off]
    return found


def _mean_angle(a: np.ndarray, b: np.ndarray) -> float:
    """Return the root mean square of the angles, degrees, between unit vectors (F, 3)."""
    angles = np.degrees(np.arccos(np.clip(np.sum(a * b, axis=1), -1, 1)))
    return float(np.sqrt(np.mean(angles**2)))


def read_mot(path: Path) -> dict[str, np.ndarray]:
    """Return the columns (F,) of a MOT file by name."""
    lines = path.read_text().splitlines()
    head = lines.index("endheader") + 1
    table = np.array([line.split() for line in lines[head + 1 :] if line.strip()], float)
    return dict(zip(lines[head].split(), table.T, strict=True))


def _mean(rows: list[dict[str, Any]], kind: str, groups: tuple[str, ...]) -> np.ndarray | None:
    """Return (2,) degrees, the mean over tracks, sides and the angles of groups."""
    names = [name for group in groups for name in _GROUPS.get(group, (_SHOULDER.get(group, ""),))]
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
    shown = [[name, *_cells(rows, hows, (name,))] for name in (*_GROUPS, *_SHOULDER)]
    shown.append(["hip and knee", *_cells(rows, hows, _LEGS)])
    shown.append(["all of motion.mot", *_cells(rows, hows, tuple(_GROUPS))])
    counts = [f"{how} {sum(row['by'] == how for row in rows)}" for how in hows]
    about = (
        f"Sequences: {', '.join(counts)}; seed 0; {results['device']}, {results['made']}, commit "
        f"{results['commit']}. Pelvis to elbow: as in motion.mot, where a shoulder's flexion and "
        "rotation have a pole at an arm that is level at the side. Below: after Wu et al. 2005, "
        f"the plane where the true arm is raised by {_RAISED[0]:.0f} to {_RAISED[1]:.0f} degrees, "
        f"the rotation where the true elbow is bent by {_BENT:.0f}, too."
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
