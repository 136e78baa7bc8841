"""Flags with the same meaning as the keys of `sequence.toml`, for every command that reads a
sequence."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cl import InputError
from psfs.cli.commandline import frame_range, path_or_name, warn
from psfs.cli.setting_flags import add_setting_flags, find_flagged_settings
from psfs.common.files import resolve_path
from psfs.common.ranges import check_number
from psfs.footage.folder import check_folder
from psfs.footage.settings import SequenceSettings
from psfs.voxels.limits import VOXEL_EDGES

if TYPE_CHECKING:
    from psfs.diagnostics.examination import Examination
    from psfs.sequence import Sequence
    from psfs.session import Session

#: Least length of the shortest view as a share of the longest one's, if --frames is not given.
_MOST_OF_THEM = 0.9
#: The flags that become overrides of `Sequence.open`.
_KEYS = tuple(path[-1] for path, _ in find_flagged_settings(SequenceSettings))


def add_sequence_flags(
    parser: argparse.ArgumentParser, frames: bool = True, fps: bool = True, several: bool = False
) -> None:
    """Add the positional FOLDER and the flags; `frames` adds --frames, `fps` adds --fps, `several`
    takes several folders, as `folders`."""
    parser.set_defaults(fps=None)
    name, count = ("folders", "+") if several else ("folder", None)
    parser.add_argument(name, nargs=count, metavar="FOLDER", help="folder with calibrated views")
    if frames:
        parser.add_argument(
            "--frames", type=frame_range, metavar="a:b", help="frames counted from 0, b excluded"
        )
    group = parser.add_argument_group(
        "sequence", "facts that the files do not state, also keys of FOLDER/sequence.toml"
    )
    without = () if fps else ("fps",)
    add_setting_flags(group, SequenceSettings, without=without, parsers=PARSERS)


def parse_sync(text: str) -> str | dict[str, int]:
    """Return `auto`, `audio`, or `cam03=5,cam01=-2` as a mapping (argparse type)."""
    if text in ("auto", "audio"):
        return text
    try:
        pairs = [item.rsplit("=", 1) for item in text.split(",")]
        shifts = {name: int(late) for name, late in pairs}
        if len(shifts) < len(pairs):
            raise ValueError
        return shifts
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is neither auto, audio nor frames by camera; expected e.g. "
            "cam03=5,cam01=-2, each camera once"
        ) from None


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]


def add_all_cameras_flag(parser: argparse.ArgumentParser) -> None:
    """Add --all-cameras, for commands that `examine_footage`."""
    parser.add_argument(
        "--all-cameras",
        action="store_true",
        help="keep cameras whose silhouettes disagree with the others' (default: left out, with a "
        "warning; --cameras states which to take)",
    )


def frame_rate(text: str) -> float:
    """Return the frames per second of `30`, `29.97` or `30000/1001` (argparse type)."""
    try:
        over, _, under = text.partition("/")
        return float(over) / float(under or 1)
    except (ValueError, ZeroDivisionError):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no frame rate; expected e.g. 30, 29.97 or 30000/1001"
        ) from None


def voxel_edge(text: str) -> float:
    """Return the edge of a voxel, m (argparse type)."""
    try:
        check_number("the edge of a voxel, m,", float(text), *VOXEL_EDGES)
    except ValueError as error:
        detail = error if isinstance(error, InputError) else f"{text!r} is no number of metres"
        raise argparse.ArgumentTypeError(str(detail)) from None
    return float(text)


def volume_box(text: str) -> Any:
    """Return `x0,x1,y0,y1,z0,z1` as [[x0, y0, z0], [x1, y1, z1]], and `own:...` as {"own": that
    list} (argparse type)."""
    try:
        numbers = text.removeprefix("own:").split(",")
        x0, x1, y0, y1, z0, z1 = (float(word) for word in numbers)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no box; expected x0,x1,y0,y1,z0,z1 in metres"
        ) from None
    box = [[x0, y0, z0], [x1, y1, z1]]
    return {"own": box} if text.startswith("own:") else box


#: How the texts of the flags are parsed that are more than a number, a text or a choice.
PARSERS: Mapping[str, Callable[[str], object]] = {
    "calibration": path_or_name, "fps": frame_rate, "sync": parse_sync, "volume": volume_box,
    "cameras": _names,
}  # fmt: skip


def collect_overrides(args: argparse.Namespace) -> dict[str, object]:
    """Return the flags of the sequence as overrides of `Sequence.open`, in plain values."""
    flags = {key: getattr(args, key) for key in _KEYS if getattr(args, key) is not None}
    if "calibration" in flags:
        flags["calibration"] = str(resolve_path(flags["calibration"]))
    return flags


def check(args: argparse.Namespace) -> None:
    """Raise MissingFileError, as opening the sequence would, if the command's FOLDER is missing."""
    check_folder(Path(args.folder))


def open_sequence(args: argparse.Namespace) -> Sequence:
    """Return the sequence that the flags describe."""
    from psfs.sequence import Sequence

    return Sequence.open(args.folder, **collect_overrides(args))


def examine_footage(
    args: argparse.Namespace, session: Session, person: bool = False
) -> Examination:
    """Examine the footage, see `examine`, and print warnings of its faults.

    The findings are written into `args`, so that a run that is opened again is the same; the
    warnings become `args.remarks`. Raises InputError if `person` is true and the unit gives a size
    that no person has.
    """
    from psfs.diagnostics.examination import examine

    opened = session.sequence
    found = examine(session, args.all_cameras)
    sequence = found.session.sequence
    unit = [str(fault) for fault in found.faults if fault.kind == "unit"]
    if unit and person:
        raise InputError(f"{sequence.name}: {unit[0]}")
    if found.left_out:
        args.cameras = sequence.rig.names
    if opened.settings.sync == "auto":
        args.sync = sequence.settings.sync
    args.remarks = [*sequence.timing_notes, *found.warnings]
    for text in args.remarks:
        warn(f"{sequence.name}: {text}")
    return found


def select_common_frames(args: argparse.Namespace, sequence: Sequence) -> range:
    """Return the frame numbers of --frames, or all; warn of views of different lengths. Raises
    InputError if no frame is selected."""
    chosen = select_frames(args, sequence)
    if args.frames is None:
        _check_counts(sequence)
    return chosen


def select_frames(args: argparse.Namespace, sequence: Sequence) -> range:
    """Return the frame numbers of --frames, or all. Raises InputError if no frame is selected."""
    chosen = range(len(sequence))[args.frames or slice(None)]
    if not chosen:
        raise InputError(
            f"--frames chooses none of the {len(sequence)} frames of {sequence.folder}"
        )
    return chosen


def _check_counts(sequence: Sequence) -> None:
    """Warn of views of different lengths. Raises InputError if many frames would be left out."""
    media = (*(sequence.footage.images or ()), *(sequence.footage.masks or ()))
    counts = {item.name: item.count for item in media}
    if len(set(counts.values())) == 1:
        return
    found = ", ".join(f"{name} {count}" for name, count in counts.items())
    if len(sequence) >= _MOST_OF_THEM * max(counts.values()):
        warn(f"{sequence.name}: unequal numbers of frames: {found}; {len(sequence)} are used")
        return
    raise InputError(
        f"{sequence.folder}: unequal numbers of frames: {found}; expected as many of each camera, "
        f"or --frames 0:{len(sequence)} for those that all have"
    )
