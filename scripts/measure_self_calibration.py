#!/usr/bin/env python3
"""Cameras and times found from a person, beside the truth, and tracks with them.

    scripts/measure_self_calibration.py SEQUENCE... -o RESULTS.json [--seeds 0 1] [--track]

takes each sequence's calibration away but for the lenses, shifts its videos by unknown times
between -20 and 20 frames (the fraction by optical flow between two pictures), runs
`psfs calibrate --person` (with --keypoints `apf calibrate`, by the sequence's keypoints.npz), and
compares: times in frames, positions in % of the rig's radius and
directions in degrees after a similarity alignment. --track tracks the shifted videos by the cameras
found and by the true ones, both with delays of whole frames.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import apf
from apf.evaluation.evaluate import evaluate, load_truth
from apf.formats.trc import JointSeries
from apf.tracking.track import Track
from cl import InputError
from psfs.cameras.calibration import find_calibration, read_calibration
from psfs.cameras.calibration.toml_tables import write_toml_tables
from psfs.cameras.camera import CameraRig
from psfs.cli.commandline import add_message_flags, frame_range, stdout
from psfs.cli.program import run_command
from psfs.common.files import write_json
from psfs.footage.media import Media, list_media, open_media
from psfs.sequence import Sequence

#: The videos begin between minus and plus this many frames.
_MOST = 20.0
#: A pixel moves if it moves by more, px; what changes by more grey levels, and px around it, is
#: interpolated along the flow.
_STILL, _CHANGED, _AROUND = 0.1, 12, 24


@dataclass(frozen=True, eq=False)
class Scene:
    """A sequence with shifted videos: frame k of camera v shows the time k + starts[v] of the
    truth."""

    folder: Path
    source: Path
    rig: CameraRig
    starts: np.ndarray


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="measure_self_calibration.py", description=__doc__.splitlines()[0]
    )
    parser.add_argument("sequences", nargs="+", type=Path, metavar="SEQUENCE")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="RESULTS.json")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0], metavar="K")
    parser.add_argument(
        "--track", nargs="?", const=slice(None), type=frame_range, metavar="a:b",
        help="track by the cameras found, too, these frames (default: all)",
    )  # fmt: skip
    parser.add_argument(
        "--calibrate", default="", metavar="FLAGS", help="more flags of psfs calibrate"
    )
    parser.add_argument(
        "--keypoints", action="store_true", help="from keypoints, then from silhouettes"
    )
    parser.add_argument(
        "--field-of-view", metavar="DEG", help="state this angle of view instead of the lenses"
    )
    add_message_flags(parser)
    parser.set_defaults(run=_run)
    return run_command(parser)


def _run(args: argparse.Namespace) -> None:
    found: list[dict[str, Any]] = []
    for source in args.sequences:
        for seed in args.seeds:
            with tempfile.TemporaryDirectory() as folder:
                scene = shift_videos(source, seed, Path(folder) / source.name)
                row = {"sequence": source.name, "seed": seed, **_measure(scene, args)}
            found.append(row)
            write_json(args.output, {"runs": found})
            stdout.print(json.dumps(row), soft_wrap=True, markup=False)


def shift_videos(source: Path, seed: int, folder: Path) -> Scene:
    """Write the sequence's videos, shifted at random, its background and its lenses."""
    calibration = find_calibration(source)
    if calibration is None:
        raise InputError(f"{source}: no calibration; expected the true one")
    rig = read_calibration(calibration)
    offsets = np.random.default_rng(seed).uniform(-_MOST, _MOST, len(rig)).round(2)
    (folder / "videos").mkdir(parents=True)
    (folder / "background").symlink_to((source / "background").resolve())
    lenses = [replace(camera, R=np.eye(3), t=np.zeros(3)) for camera in rig]
    write_toml_tables(folder / "lenses.toml", CameraRig(tuple(lenses)))
    starts = offsets - offsets.min()
    files = list_media(source / "videos")
    for camera, start in zip(rig, starts, strict=True):
        media = open_media(camera.name, files[camera.name])
        write_shifted(media, float(start), folder / "videos" / f"{camera.name}.avi")
    return Scene(folder, source, rig, starts)


def write_shifted(media: Media, start: float, path: Path) -> None:
    """Write a video (FFV1, without loss) whose frame 0 shows the time `start` of the given one."""
    first, fraction = int(start), start - int(start)
    codec = cv2.VideoWriter_fourcc(*"FFV1")  # type: ignore[attr-defined]
    writer = cv2.VideoWriter(str(path), codec, media.fps or 30.0, media.size)
    flow = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)  # type: ignore[attr-defined]
    before = None
    for picture in media.frames(range(first, media.count)):
        if fraction == 0:
            writer.write(picture)
        elif before is not None:
            writer.write(interpolate_pictures(before, picture, fraction, flow))
        before = picture
    writer.release()


def shift_keypoints(scene: Scene) -> Path:
    """Write the sequence's keypoints at the times of the shifted videos; return their file."""
    with np.load(scene.source / "keypoints.npz") as file:
        arrays = {key: file[key] for key in file.files}
    shortest = min(item.count for item in list_shifted(scene))
    shifted = []
    for points, start in zip(arrays["keypoints"], scene.starts, strict=True):
        first, fraction = int(start), float(start) - int(start)
        rows = np.arange(shortest) + first
        after = np.minimum(rows + 1, len(points) - 1)
        shifted.append((1 - fraction) * points[rows] + fraction * points[after])
    path = scene.folder / "keypoints.npz"
    np.savez(path, **{**arrays, "keypoints": np.stack(shifted)})
    return path


def list_shifted(scene: Scene) -> list[Media]:
    """Return the shifted videos in the order of the cameras."""
    files = list_media(scene.folder / "videos")
    return [open_media(name, files[name]) for name in scene.rig.names]


def interpolate_pictures(
    first: np.ndarray, second: np.ndarray, fraction: float, flow: cv2.DenseOpticalFlow
) -> np.ndarray:
    """Return the picture (h, w, 3) uint8 at a fraction of the time between two pictures.

    The flow is carried on to that time, the fastest last, and both pictures are fetched along it
    and mixed (Baker et al., IJCV 92, 2011). Only what changes is interpolated so.
    """
    changed = cv2.absdiff(first, second).max(axis=-1) > _CHANGED
    x, y, width, height = cv2.boundingRect(cv2.medianBlur(changed.astype(np.uint8), 5))
    out = cv2.addWeighted(first, 1 - fraction, second, fraction, 0)
    if width:
        rows = slice(max(0, y - _AROUND), y + height + _AROUND)
        columns = slice(max(0, x - _AROUND), x + width + _AROUND)
        parts = [np.ascontiguousarray(of[rows, columns]) for of in (first, second)]
        out[rows, columns] = _interpolate_part(parts[0], parts[1], fraction, flow)
    return out


def _interpolate_part(
    first: np.ndarray, second: np.ndarray, fraction: float, flow: cv2.DenseOpticalFlow
) -> np.ndarray:
    grey = [cv2.cvtColor(of, cv2.COLOR_BGR2GRAY) for of in (first, second)]
    moved = flow.calc(grey[0], grey[1], None)
    height, width = grey[0].shape
    speed = np.linalg.norm(moved, axis=-1)
    rows, columns = np.nonzero(speed > _STILL)
    order = np.argsort(speed[rows, columns])
    rows, columns = rows[order], columns[order]
    by = moved[rows, columns]
    carried = np.zeros_like(moved)
    for half in np.ndindex(2, 2):  # the four pixels around, so that no holes are left
        x = (np.floor(columns + fraction * by[:, 0]).astype(int) + half[0]).clip(0, width - 1)
        y = (np.floor(rows + fraction * by[:, 1]).astype(int) + half[1]).clip(0, height - 1)
        carried[y, x] = by
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).astype(np.float32)
    fetched = [
        cv2.remap(of, grid + share * carried, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        for of, share in ((first, -fraction), (second, 1 - fraction))
    ]
    return cv2.addWeighted(fetched[0], 1 - fraction, fetched[1], fraction, 0)


def _measure(scene: Scene, args: argparse.Namespace) -> dict[str, Any]:
    out = scene.folder / "found"
    began = time.perf_counter()
    flags = ["--intrinsics", str(scene.folder / "lenses.toml")]
    if args.field_of_view is not None:
        flags = ["--field-of-view", args.field_of_view]
    flags += [*args.calibrate.split(), "-o", str(out)]
    program = "psfs"
    if args.keypoints:
        program = "apf"
        flags += ["--keypoints", str(shift_keypoints(scene))]
    else:
        flags.append("--person")
    done = _call(program, "calibrate", str(scene.folder), *flags)
    row: dict[str, Any] = {
        "starts": scene.starts.tolist(),
        "seconds": round(time.perf_counter() - began, 1),
    }
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["?"]
        return {**row, "exit_code": done.returncode, "refused": lines[-1]}
    report = json.loads((out / "calibration.json").read_text())
    rig = read_calibration(out / "calibration.toml")
    cameras = [report["cameras"][camera.name] for camera in scene.rig]
    lags = np.array([own["late_frames"] for own in cameras])
    row |= compare_rigs(rig, scene.rig)
    if args.field_of_view is not None:
        pairs = zip(rig, scene.rig, strict=True)
        row["focal_percent"] = [round(100 * (a.K[0, 0] / b.K[0, 0] - 1), 2) for a, b in pairs]
    row["time_errors"] = _centre(lags + scene.starts).round(4).tolist()
    row["misfits"] = [own["misfit_px"] for own in cameras]
    row["path"] = report["path_m"]
    if args.track is not None:
        row |= _compare_tracks(scene, rig, report["sync"], args.track)
    return row


def _centre(values: np.ndarray) -> np.ndarray:
    return values - np.median(values)


def _call(program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    code = f"import sys; from {program}.cli import main; sys.exit(main(sys.argv[1:]))"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False
    )


def align_rigs(found: CameraRig, truth: CameraRig) -> tuple[float, np.ndarray, np.ndarray]:
    """Return the size, rotation (3, 3) and shift (3,) that move the cameras found to the true ones:
    the rotation by the directions, the rest by the places."""
    total = sum(b.R.T @ a.R for a, b in zip(found, truth, strict=True))
    U, _, Vt = np.linalg.svd(total)
    R = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    a, b = found.centres @ R.T, truth.centres
    own, true = a - a.mean(axis=0), b - b.mean(axis=0)
    size = float((own * true).sum() / (own**2).sum())
    return size, R, b.mean(axis=0) - size * a.mean(axis=0)


def compare_rigs(found: CameraRig, truth: CameraRig) -> dict[str, Any]:
    """Return the errors of each camera: place, % of the rig's radius, and direction, degrees, after
    a similarity alignment; and the errors of up, degrees, of the size, %, and of the floor's height
    at the origin, mm, without it."""
    size, R, shift = align_rigs(found, truth)
    places = size * found.centres @ R.T + shift - truth.centres
    radius = np.linalg.norm(truth.centres - truth.centres.mean(axis=0), axis=1).mean()
    turns = [cv2.Rodrigues(a.R @ R.T @ b.R.T)[0].ravel() for a, b in zip(found, truth, strict=True)]
    return {
        "places_percent": (100 * np.linalg.norm(places, axis=1) / radius).round(3).tolist(),
        "directions_degrees": np.degrees(np.linalg.norm(turns, axis=1)).round(3).tolist(),
        "up_degrees": round(float(np.degrees(np.arccos(min(1.0, R[2, 2])))), 3),
        "size_percent": round(100 * (1 / size - 1), 3),
        "floor_mm": round(1000 * float(shift[2]), 1),
    }


def _compare_tracks(scene: Scene, found: CameraRig, sync: str, frames: slice) -> dict[str, Any]:
    """Return the mean errors, mm, of tracks by the cameras found, after the similarity alignment,
    and by the true ones."""
    true = find_calibration(scene.source)
    late = np.round(-(scene.starts - scene.starts.max())).astype(int)
    names = scene.rig.names
    stated = ",".join(f"{name}={by}" for name, by in zip(names, late, strict=True))
    row: dict[str, Any] = {}
    ways = (
        ("found", scene.folder / "found" / "calibration.toml", sync, align_rigs(found, scene.rig)),
        ("true", true, stated, (1.0, np.eye(3), np.zeros(3))),
    )
    for way, path, delays, alignment in ways:
        try:
            sequence = Sequence.open(scene.folder, calibration=path, sync=_read_delays(delays))
            track = apf.track(sequence, frames=frames)
        except InputError as error:
            row[f"track_{way}"] = str(error)
            continue
        row[f"track_{way}_mm"] = round(_track_error(scene, track, delays, alignment), 2)
    return row


def _track_error(
    scene: Scene, track: Track, delays: str, alignment: tuple[float, np.ndarray, np.ndarray]
) -> float:
    """Return the mean error, mm, of a track whose frame k is frame k + delay of each camera."""
    size, R, shift = alignment
    own = np.array([_read_delays(delays)[name] for name in scene.rig.names])
    begin = float((own - own.min() + scene.starts).mean())
    truth = load_truth(scene.source / "truth.npz")
    truth = truth.resample(truth.fps, begin)
    moved = JointSeries(
        track.joint_names, size * track.joints @ R.T + shift, track.fps, track.frames
    )
    return 1000 * evaluate(moved, truth).mean_error


def _read_delays(text: str) -> dict[str, int]:
    pairs = (pair.split("=") for pair in text.split(","))
    return {name: int(late) for name, late in pairs}


if __name__ == "__main__":
    sys.exit(main())
