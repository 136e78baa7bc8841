"""`psfs calibrate FOLDER -o OUT`: cameras from a board or a wand waved through the volume, or given
cameras corrected by a take."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.table import Table

from cl import InputError
from psfs.calibration.calibrator import CalibrationResult, calibrate_cameras
from psfs.calibration.intrinsics import read_intrinsics
from psfs.calibration.pictures import write_rig, write_view
from psfs.calibration.report import (
    ViewReport,
    calibration_summary,
    judge_calibration,
    summarise_views,
)
from psfs.calibration.scene import align_to_cameras, align_to_floor, rigid_transform
from psfs.calibration.start.motion_capture import read_measured_wand
from psfs.calibration.targets.board_files import read_board
from psfs.calibration.targets.boards import CharucoFinder, ChessboardFinder
from psfs.calibration.targets.detection import (
    Finder,
    find_hint,
    find_sightings,
    median_pictures,
    open_uncalibrated,
)
from psfs.calibration.targets.markers import MarkerFinder
from psfs.calibration.targets.target import Sighting, make_wand
from psfs.cameras.calibration.toml_tables import write_toml_tables
from psfs.cameras.camera import CameraRig
from psfs.cameras.units import rotation_to_z_up
from psfs.cli.commandline import make_table, progress_bar, stdout, warn
from psfs.cli.person import calibrate_from_person
from psfs.cli.refinement import refine
from psfs.common.files import write_json
from psfs.common.outputs import output_folder
from psfs.common.requests import SETTINGS, write_settings
from psfs.common.system import versions
from psfs.request import (
    CALIBRATION,
    MOST_TARGET_FRAMES,
    PICTURES,
    REPORT,
    RIG,
    CalibrateRequest,
)
from psfs.sequence import Sequence

#: Flags of one kind of target.
_OF_C3D = ("markers", "c3d_begins", "up")
_OF_TARGETS = ("intrinsics", "floor", "height", "frames", "squares", "square", *_OF_C3D)
_OF_PERSON = ("stature", "field_of_view")
#: Squares, and their side, m, of a board that is printed unless others are stated: an A4 page.
_PRINTED = (7, 5), 0.037
_OF_BOARDS, _OF_CHARUCO = ("squares", "square"), ("marker", "dictionary", "boards")
#: Kinds of boards that --board takes, beside files.
_KINDS = ("charuco", "chessboard")


def run(request: CalibrateRequest) -> None:
    if request.print_board is not None:
        _print_board(request)
        return
    missing = [
        what for what, of in (("FOLDER", request.folder), ("-o OUT", request.output)) if of is None
    ]
    if request.folder is None or request.output is None:
        raise InputError(
            f"no {' and no '.join(missing)}; expected psfs calibrate FOLDER -o OUT, or "
            "--print-board FILE.pdf alone: docs/calibration.md"
        )
    inputs = [p for p in (request.folder, request.c3d, request.intrinsics) if p is not None]
    expected = (CALIBRATION, REPORT, RIG, SETTINGS, f"{PICTURES}/*.png")
    with output_folder(request.output, request.COMMAND, inputs, expected):
        if not request.person:
            request.refuse(_OF_PERSON, "applies only to a person; expected --person with it")
        if not request.refine:
            request.refuse(
                ["calibration"], "applies only to given cameras; expected --refine with it"
            )
        if request.refine:
            request.refuse(
                _OF_TARGETS, "applies only to boards and wands; expected none with --refine"
            )
            refine(request)
        elif request.person:
            unused = [flag for flag in _OF_TARGETS if flag != "intrinsics"]
            request.refuse(unused, "applies only to boards and wands; expected none with --person")
            request.refuse(["sync"], "is found from the person; expected none with --person")
            calibrate_from_person(request)
        else:
            _calibrate(request)


def _print_board(request: CalibrateRequest) -> None:
    """Write the PDF of a ChArUco board."""
    from psfs.calibration.targets.print_board import write_board_pdf  # loads Matplotlib

    of_footage = {"folder", "output", "board", "wand", "c3d", "refine", "person", *_OF_PERSON}
    request.refuse(
        of_footage.union(_OF_TARGETS).difference(_OF_BOARDS),
        "applies only to footage; expected none with --print-board",
    )
    path = request.print_board
    assert path is not None
    if path.suffix.lower() != ".pdf":
        raise InputError(f"{path}: expected a name that ends in .pdf")
    squares = request.squares or _PRINTED[0]
    square = _PRINTED[1] if request.square is None else request.square
    marker = 0.75 * square if request.marker is None else request.marker
    family = "4X4" if request.dictionary == "auto" else request.dictionary
    width, height = write_board_pdf(path, squares, (square, marker), family, request.boards)
    several = f" --boards {request.boards}" if request.boards > 1 else ""
    stdout.print(
        f"wrote {path}: {width:.0f} x {height:.0f} mm; print it at 100 %, glue it on something "
        f"flat, film it: psfs calibrate FOLDER --board charuco --squares {squares[0]}x{squares[1]} "
        f"--square {square:g}{several} -o OUT"
    )


def _calibrate(request: CalibrateRequest) -> None:
    request = _read_board_file(request)
    boards = make_board_finders(request)
    board = boards[0] if boards else None
    views = open_uncalibrated(request.folder or Path(), request.capture)
    chosen, floor = _choose_frames(request, views)
    finder = board or _marker_finder(request, views, chosen)
    finders = boards or [finder]
    path, known = request.intrinsics, request.intrinsics is not None
    cameras = list(views.rig) if path is None else read_intrinsics(path, views.rig, board)
    sightings: list[Sighting] = []
    with progress_bar() as bar:
        for found in bar.track(
            find_sightings(views, chosen, finders), len(chosen), description="looking"
        ):
            sightings += found
    if not sightings:
        raise InputError(_describe_failure(views, chosen, finder))
    target = replace(finder.target, boards=len(finders))
    result = calibrate_cameras(cameras, target, sightings, known)
    floor = [len(finders) * frame + n for frame in floor for n in range(len(finders))]
    result, warnings = _align_to_world(request, result, floor)
    _write(request, views, result, warnings)


def make_board_finders(
    request: CalibrateRequest,
) -> list[CharucoFinder] | list[ChessboardFinder]:
    """Return the detectors of the boards; none for a wand. Raises InputError for flags that exclude
    each other."""
    if request.board is None and request.wand is None and request.c3d is None:
        raise InputError(
            "no target is stated; expected --person (somebody who walks about), --board, --wand or "
            "--c3d, or --refine for given cameras: docs/calibration.md"
        )
    if request.c3d is None:
        request.refuse(_OF_C3D, "applies only to motion capture; expected --c3d with it")
    if request.floor is None:
        request.refuse(
            ["height"], "applies only to a target on the floor; expected --floor with it"
        )
    if request.board != "charuco":
        request.refuse(
            _OF_CHARUCO, "applies only to ChArUco boards; expected --board charuco with it"
        )
    if request.board is None:
        request.refuse(_OF_BOARDS, "applies only to boards; expected --board with it")
        return []
    if request.squares is None or request.square is None:
        raise InputError(
            "--board needs --squares CxR and --square M, as printed on it; psfs calibrate "
            "--print-board FILE.pdf makes one"
        )
    if request.board == "chessboard":
        return [ChessboardFinder(request.squares, request.square)]
    marker = 0.75 * request.square if request.marker is None else request.marker
    step = request.squares[0] * request.squares[1] // 2
    return [
        CharucoFinder(request.squares, request.square, marker, request.dictionary, number * step)
        for number in range(request.boards)
    ]


def _read_board_file(request: CalibrateRequest) -> CalibrateRequest:
    """Return the request with what a board's file says in place of the file; other flags beat
    it."""
    if request.board is None or request.board in _KINDS:
        return request
    board = read_board(Path(request.board))
    return request.replace(
        board=board.kind,
        squares=request.squares or board.squares,
        square=board.square if request.square is None else request.square,
        marker=board.marker if request.marker is None else request.marker,
        dictionary=board.dictionary if request.dictionary == "auto" else request.dictionary,
    )


def _marker_finder(request: CalibrateRequest, views: Sequence, chosen: list[int]) -> MarkerFinder:
    if request.c3d is not None:
        target = read_measured_wand(
            request.c3d, request.markers, chosen, views.fps, request.c3d_begins
        )
    else:
        target = make_wand(request.wand or ())
    return MarkerFinder(target, median_pictures(views, chosen))


def _choose_frames(request: CalibrateRequest, views: Sequence) -> tuple[list[int], list[int]]:
    """Return the frames in which to detect the target, and those of them in which it lies on the
    floor."""
    every = range(len(views))
    chosen = every[request.frames or slice(None)]
    if request.frames is None or request.frames.step is None:
        chosen = chosen[:: max(1, -(-len(chosen) // MOST_TARGET_FRAMES))]
    floor = list(every[request.floor]) if request.floor is not None else []
    for flag, frames in (("frames", chosen), ("floor", floor)):
        if getattr(request, flag) is not None and not frames:
            raise InputError(
                f"--{flag} chooses none of the {len(views)} frames of {request.folder}"
            )
    if floor and request.c3d is not None:
        raise InputError("--floor and --c3d; expected one of them, for the C3D has its own floor")
    return sorted({*chosen, *floor}), floor


def _describe_failure(views: Sequence, chosen: list[int], finder: Finder) -> str:
    """Return the error message for footage in which no picture shows the target."""
    cameras = "one camera" if len(views.rig) == 1 else f"{len(views.rig)} cameras"
    where = f"{len(chosen)} frames of {cameras}"
    what = f"{views.folder}: no {finder.target.name} in {where}"
    if isinstance(finder, MarkerFinder):
        return f"{what}; expected its markers to be the only bright spots that move"
    hint = find_hint(views, chosen, finder.describe_other_board)
    if hint is not None:
        return f"{what}, but {hint}; expected what the flags of the board say"
    return (
        f"{what}; {finder.describe_search()}; expected it flat, sharp, lit evenly, with a "
        "white rim, and large: see docs/calibration.md"
    )


def _align_to_world(
    request: CalibrateRequest, result: CalibrationResult, floor: list[int]
) -> tuple[CalibrationResult, list[str]]:
    """Return the result in a world with Z up, and the warnings."""
    if result.scene.target.known is not None:
        if request.up is None:
            return result, []
        return result.transform(rigid_transform(rotation_to_z_up(request.up), np.zeros(3))), []
    if floor:
        world = align_to_floor(result.scene, floor, request.height)
        return result.transform(world), []
    text = (
        "no --floor is stated: Z is the cameras' mean up, and Z = 0 the lowest place of the "
        f"{result.scene.target.name}"
    )
    return result.transform(align_to_cameras(result.scene)), [text]


def _write(
    request: CalibrateRequest,
    views: Sequence,
    result: CalibrationResult,
    warnings: list[str],
) -> None:
    out = request.output or Path()
    found = summarise_views(result, request.intrinsics is not None)
    what: dict[str, object] = {
        "folder": str(views.folder),
        "intrinsics": "found" if request.intrinsics is None else str(request.intrinsics),
        "floor": "stated" if request.floor is not None else "C3D" if request.c3d else "cameras",
        "versions": versions(),
    }
    write_toml_tables(out / CALIBRATION, CameraRig(result.scene.cameras))
    write_json(out / REPORT, calibration_summary(result, found, what, warnings))
    write_rig(out / RIG, result, found)
    _write_pictures(out / PICTURES, views, result, found)
    write_settings(out, request)
    stdout.print(_table(found))
    for view in found:
        for fault in view.faults:
            warn(f"{view.camera.name} {fault}", stdout)
    for text in warnings:
        warn(text, stdout)
    stdout.print(f"{judge_calibration(found)}; wrote {out}")


def _write_pictures(
    folder: Path, views: Sequence, result: CalibrationResult, found: list[ViewReport]
) -> None:
    """Write a picture per camera: its detected points, drawn over its picture of the frame with the
    most detections."""
    frames = [sighting.frame // result.scene.target.boards for sighting in result.sightings]
    pictures = views.rig.crop(views.read(max(set(frames), key=frames.count)).images)
    for view, picture in zip(found, pictures, strict=True):
        write_view(folder / f"{view.camera.name}.png", view, picture)


def _table(found: list[ViewReport]) -> Table:
    columns = ("mean", "median", "95 %", "frames", "picture covered")
    table = make_table("Reprojection error, px", ["camera"], columns)
    for view in found:
        figures = [f"{view.figures()[key]:.2f}" for key in ("mean", "median", "p95")]
        seen = view.coverage
        table.add_row(view.camera.name, *figures, str(seen.frames), f"{100 * seen.share:.0f} %")
    return table
