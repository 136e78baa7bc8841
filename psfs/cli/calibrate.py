"""`psfs calibrate FOLDER -o OUT`: cameras from a board or a wand waved through the volume."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from cl import InputError
from psfs.calibration.calibrator import CalibrationResult, calibrate_cameras
from psfs.calibration.config import CalibrationConfig
from psfs.calibration.intrinsics import read_intrinsics
from psfs.calibration.pictures import write_rig, write_view
from psfs.calibration.report import (
    ViewReport,
    calibration_summary,
    judge_calibration,
    summarise_views,
)
from psfs.calibration.scene import rigid_transform
from psfs.calibration.start.motion_capture import read_measured_wand
from psfs.calibration.targets.boards import DICTIONARIES, CharucoFinder, ChessboardFinder
from psfs.calibration.targets.detection import (
    Finder,
    crop_pictures,
    find_hint,
    find_sightings,
    median_pictures,
    open_uncalibrated,
)
from psfs.calibration.targets.markers import MarkerFinder
from psfs.calibration.targets.target import Sighting, make_wand
from psfs.calibration.world import align_to_cameras, align_to_floor
from psfs.cameras.calibration.toml_tables import write_toml_tables
from psfs.cameras.camera import CameraRig
from psfs.cameras.units import rotation_to_z_up
from psfs.cli.commandline import add_command, frame_range, progress_bar, stdout, warn
from psfs.cli.sequence_flags import frame_rate, sync_of
from psfs.cli.settings import FILE, add_configs, refuse_unused, write_settings
from psfs.common.configs import config_of
from psfs.common.files import write_json
from psfs.common.outputs import output_folder
from psfs.common.ranges import check_range
from psfs.footage.settings import Settings
from psfs.output.reconstruction_folder import versions
from psfs.sequence import Sequence

CALIBRATION, REPORT, RIG, PICTURES = "calibration.toml", "calibration.json", "rig.png", "cameras"
#: Of the keys of `sequence.toml`, those that a calibration needs.
_STATED = ("cameras", "fps", "sync")
_BOARDS = ("charuco", "chessboard")
#: Flags of one kind of target.
_OF_C3D = ("markers", "c3d_begins", "up")
_OF_BOARDS, _OF_CHARUCO = ("squares", "square"), ("marker", "dictionary")


def register(commands: argparse._SubParsersAction) -> None:
    help = "find the cameras from a board or a wand that was waved through the volume"
    parser = add_command(commands, "calibrate", _run, help=help)
    parser.description = (
        f"{help}. FOLDER holds videos/, images/<camera>/, or a video or folder of pictures per "
        f"camera. OUT gets {CALIBRATION} (metres, Z up), {REPORT}, {RIG}, and a picture per camera "
        f"in {PICTURES}/: reprojection errors, where the target was seen, what to do better. "
        "Recipe: docs/calibration.md."
    )
    parser.add_argument("folder", metavar="FOLDER", help="footage of the board or wand")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT", help="folder")
    _add_target_flags(parser)
    group = parser.add_argument_group("cameras and world")
    group.add_argument(
        "--intrinsics", type=Path, metavar="PATH",
        help="intrinsics that are kept: a calibration, or a folder with a video or pictures of the "
        "board per camera (default: found, too)",
    )  # fmt: skip
    group.add_argument(
        "--floor", type=frame_range, metavar="FRAME",
        help="frame, or a:b, in which the board or wand lies on the floor: Z = 0, X along it "
        "(default: Z is the cameras' mean up, with a warning)",
    )  # fmt: skip
    group.add_argument(
        "--height", type=float, default=0.0, metavar="M",
        help="of the target's points above the floor, such as the radius of markers (default: 0)",
    )  # fmt: skip
    group = parser.add_argument_group("footage")
    group.add_argument(
        "--frames", type=frame_range, metavar="a:b", help="frames counted from 0, b excluded "
        f"(default: all, at most {CalibrationConfig().most_frames}, evenly spread)",
    )  # fmt: skip
    group.add_argument(
        "--cameras", type=lambda text: text.split(","), metavar="A,B,C", help="only these cameras"
    )
    group.add_argument("--fps", type=frame_rate, metavar="N", help="frames per second")
    group.add_argument(
        "--sync", type=sync_of, metavar="CAMERA=N,...",
        help="cameras that come N of their frames later than the others, or earlier (-N)",
    )  # fmt: skip
    add_configs(
        parser, calibration=lambda values, where: config_of(CalibrationConfig, values, where)
    )


def _add_target_flags(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("target", "one of --board, --wand and --c3d")
    kind = group.add_mutually_exclusive_group()
    kind.add_argument("--board", choices=_BOARDS, help="a board with squares")
    kind.add_argument(
        "--wand", type=_lengths, metavar="M|M,M",
        help="a wand of two or three bright markers, m from each to the next: 0.5 or 0.2,0.3",
    )  # fmt: skip
    kind.add_argument(
        "--c3d", type=Path, metavar="FILE",
        help="a wand whose markers a motion-capture system measured: cameras in its frame",
    )  # fmt: skip
    group.add_argument(
        "--squares", type=_squares, metavar="CxR", help="squares of the board, as 7x5, not "
        "the inner corners",
    )  # fmt: skip
    group.add_argument("--square", type=float, metavar="M", help="side of a square, m")
    group.add_argument(
        "--marker", type=float, metavar="M",
        help="side of a ChArUco board's markers, m (default: 3/4 of a square)",
    )  # fmt: skip
    group.add_argument(
        "--dictionary", default="auto", choices=("auto", *DICTIONARIES),
        help="markers of a ChArUco board (default: those that are seen)",
    )  # fmt: skip
    group.add_argument(
        "--markers", type=lambda text: text.split(","), metavar="A,B[,C]",
        help="names of the wand's markers in the C3D file, along it (default: all of the file)",
    )  # fmt: skip
    group.add_argument(
        "--c3d-begins", type=float, default=0.0, metavar="S",
        help="s after the first picture at which the C3D file begins (default: 0)",
    )  # fmt: skip
    group.add_argument(
        "--up", metavar="AXIS", help="up axis of the C3D file: z, -z, y, -y, x or -x (default: z)"
    )


def _lengths(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no wand; expected M or M,M") from None


def _squares(text: str) -> tuple[int, int]:
    try:
        columns, rows = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no board; expected as 7x5") from None
    return columns, rows


def _run(args: argparse.Namespace) -> None:
    inputs = [Path(args.folder), *(p for p in (args.c3d, args.intrinsics) if p is not None)]
    expected = (CALIBRATION, REPORT, RIG, FILE, f"{PICTURES}/*.png")
    with output_folder(args.output, args.parser.prog, inputs, expected):
        _calibrate(args)


def _calibrate(args: argparse.Namespace) -> None:
    check_range("--height, m,", args.height, -10, 10, ends=True)
    config: CalibrationConfig = args.configs.get("calibration", CalibrationConfig())
    board = _board_of(args)
    stated = {key: getattr(args, key) for key in _STATED if getattr(args, key) is not None}
    views = open_uncalibrated(Path(args.folder), Settings.of(stated))
    chosen, floor = _chosen(args, views, config)
    finder = board or _marker_finder(args, views, chosen)
    known = args.intrinsics is not None
    cameras = read_intrinsics(args.intrinsics, views.rig, board) if known else list(views.rig)
    sightings: list[Sighting] = []
    with progress_bar() as bar:
        for found in bar.track(
            find_sightings(views, chosen, finder), len(chosen), description="looking"
        ):
            sightings += found
    if not sightings:
        raise InputError(_none_found(views, chosen, finder))
    result = calibrate_cameras(cameras, finder.target, sightings, known, config)
    result, warnings = _in_world(args, result, floor)
    _write(args, views, result, config, warnings)


def _board_of(args: argparse.Namespace) -> CharucoFinder | ChessboardFinder | None:
    """Return what finds the board, None for a wand. Raises InputError for flags that do not go
    together."""
    if args.board is None and args.wand is None and args.c3d is None:
        raise InputError("no target is stated; expected --board, --wand or --c3d")
    if args.c3d is None:
        refuse_unused(args, _OF_C3D, "is of motion capture; expected --c3d with it")
    if args.floor is None:
        refuse_unused(args, ["height"], "is of what lies on the floor; expected --floor with it")
    if args.board != "charuco":
        refuse_unused(args, _OF_CHARUCO, "is of ChArUco boards; expected --board charuco with it")
    if args.board is None:
        refuse_unused(args, _OF_BOARDS, "is of boards; expected --board with it")
        return None
    if args.squares is None or args.square is None:
        raise InputError("--board needs --squares CxR and --square M")
    if args.board == "chessboard":
        return ChessboardFinder(args.squares, args.square)
    marker = 0.75 * args.square if args.marker is None else args.marker
    return CharucoFinder(args.squares, args.square, marker, args.dictionary)


def _marker_finder(args: argparse.Namespace, views: Sequence, chosen: list[int]) -> MarkerFinder:
    if args.c3d is not None:
        target = read_measured_wand(args.c3d, args.markers, chosen, views.fps, args.c3d_begins)
    else:
        target = make_wand(args.wand)
    return MarkerFinder(target, median_pictures(views, chosen))


def _chosen(
    args: argparse.Namespace, views: Sequence, config: CalibrationConfig
) -> tuple[list[int], list[int]]:
    """Return the frames to look at, and those of them in which the target lies on the floor."""
    every = range(len(views))
    chosen = every[args.frames or slice(None)]
    if args.frames is None or args.frames.step is None:
        chosen = chosen[:: max(1, -(-len(chosen) // config.most_frames))]
    floor = list(every[args.floor]) if args.floor is not None else []
    for flag, frames in (("frames", chosen), ("floor", floor)):
        if getattr(args, flag) is not None and not frames:
            raise InputError(f"--{flag} chooses none of the {len(views)} frames of {args.folder}")
    if floor and args.c3d is not None:
        raise InputError("--floor and --c3d; expected one of them, for the C3D has its own floor")
    return sorted({*chosen, *floor}), floor


def _none_found(views: Sequence, chosen: list[int], finder: Finder) -> str:
    """Return the error's line where no picture shows the target."""
    where = f"{len(chosen)} frames of {len(views.rig)} cameras"
    what = f"{views.folder}: no {finder.target.name} in {where}"
    if isinstance(finder, MarkerFinder):
        return f"{what}; expected its markers to be the only bright spots that move"
    seen = find_hint(views, chosen, finder.hint)  # type: ignore[attr-defined]
    if seen is not None:
        return f"{what}, but {seen}; expected what the flags of the board say"
    return f"{what}; expected it flat, sharp, lit evenly, and with a white rim"


def _in_world(
    args: argparse.Namespace, result: CalibrationResult, floor: list[int]
) -> tuple[CalibrationResult, list[str]]:
    """Return the result in a world with Z up, and what to warn of."""
    if result.target.known is not None:
        if args.up is None:
            return result, []
        return result.transform(rigid_transform(rotation_to_z_up(args.up), np.zeros(3))), []
    if floor:
        world = align_to_floor(result.scene, result.target, floor, args.height)
        return result.transform(world), []
    text = (
        "no --floor is stated: Z is the cameras' mean up, and Z = 0 the lowest place of the "
        f"{result.target.name}"
    )
    return result.transform(align_to_cameras(result.scene, result.target)), [text]


def _write(
    args: argparse.Namespace,
    views: Sequence,
    result: CalibrationResult,
    config: CalibrationConfig,
    warnings: list[str],
) -> None:
    out: Path = args.output
    found = summarise_views(result, args.intrinsics is not None, config)
    what: dict[str, Any] = {
        "folder": str(views.folder),
        "intrinsics": "found" if args.intrinsics is None else str(args.intrinsics),
        "floor": "stated" if args.floor is not None else "C3D" if args.c3d else "cameras",
        "versions": versions(),
    }
    write_toml_tables(out / CALIBRATION, CameraRig(result.scene.cameras))
    write_json(out / REPORT, calibration_summary(result, found, what, warnings))
    write_rig(out / RIG, result, found)
    _write_pictures(out / PICTURES, views, result, found)
    write_settings(out, args, {"calibration": config})
    stdout.print(_table(found))
    for view in found:
        for fault in view.faults:
            warn(f"{view.camera.name} {fault}", stdout)
    for text in warnings:
        warn(text, stdout)
    stdout.print(f"{judge_calibration(found)}; wrote {out}", soft_wrap=True)


def _write_pictures(
    folder: Path, views: Sequence, result: CalibrationResult, found: list[ViewReport]
) -> None:
    """Write a picture per camera, its points over its picture of the frame that most see."""
    frames = [sighting.frame for sighting in result.sightings]
    shown = crop_pictures(views.read(max(set(frames), key=frames.count)), views.rig)
    for view, picture in zip(found, shown, strict=True):
        write_view(folder / f"{view.camera.name}.png", view, picture)


def _table(found: list[ViewReport]) -> Table:
    table = Table("camera", title="Reprojection error, px", title_justify="left")
    for title in ("mean", "median", "95 %", "frames", "picture covered"):
        table.add_column(title, justify="right")
    for view in found:
        figures = [f"{view.figures()[key]:.2f}" for key in ("mean", "median", "p95")]
        table.add_row(view.camera.name, *figures, str(view.frames), f"{100 * view.coverage:.0f} %")
    return table
