"""The requests of `psfs`: what describes a take and its device, and what each command takes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import Field

from cl import InputError
from psfs.calibration.targets.dictionaries import DICTIONARIES
from psfs.common.config import part
from psfs.common.files import check_folder, resolve_path
from psfs.common.ranges import check_number
from psfs.common.requests import Flag, Group, Part, Presets, Request
from psfs.diagnostics.config import DEFINITION
from psfs.footage.settings import SequenceSettings, join_delays, split_delays
from psfs.mesh.config import FORMATS as MESH_FORMATS
from psfs.mesh.config import MOST_SMOOTHING, SMOOTHING
from psfs.presets import PRESETS
from psfs.self_calibration.config import PersonConfig
from psfs.voxels.config import DEBRIS_SHARE, VOXEL_EDGES, ReconstructionConfig

T = TypeVar("T")

#: Greatest number of voxels along an axis in --grid.
_MOST_ALONG = 10_000
#: The programs whose calibration is written: the names of `psfs.cameras.calibration.writers`.
FORMATS = ("caliscope", "colmap", "easymocap", "opencv", "panoptic", "qualisys")
#: Greatest number of frames that are searched for a target, evenly spread over the footage.
MOST_TARGET_FRAMES = 300
#: Names of the files and folder that a calibration is written to.
CALIBRATION, REPORT, RIG, PICTURES = "calibration.toml", "calibration.json", "rig.png", "cameras"
#: The file of `psfs silhouettes`, and the frames shown by default, spread over the sequence.
SILHOUETTES, SHOWN = "silhouettes.json", 6
#: Definition of the figures that `psfs mesh --check` writes.
MESH_DEFINITION = (
    "IoU of the projected mesh (pixels whose centre's ray meets it) with the frame's own "
    "silhouette, which psfs check defines"
)


def path_or_name(text: str) -> str:
    """Return the absolute path of an existing file or folder, else the text unchanged."""
    path = Path(text)
    return str(resolve_path(path)) if path.exists() else text


def file_or_name(text: str) -> str:
    """Return the absolute path of an existing file, else the text unchanged: a folder may be called
    as something shipped is."""
    return path_or_name(text) if Path(text).is_file() else text


def _expecting(what: str) -> Callable[[Callable[[str], T]], Callable[[str], T]]:
    """Return a decorator of functions that parse a text: it turns ValueError into InputError, which
    says `what` was found and expected."""

    def decorated(parse: Callable[[str], T]) -> Callable[[str], T]:
        @wraps(parse)
        def parse_or_fail(text: str) -> T:
            try:
                return parse(text)
            except InputError:
                raise
            except (ValueError, ZeroDivisionError):
                raise InputError(f"{text!r} is {what}") from None

        return parse_or_fail

    return decorated


@_expecting("no frame range; expected a:b, a:b:step or a number, counted from 0")
def frame_range(text: str) -> slice:
    """Return `a:b`, `a:`, `:b`, `a:b:step` or a single frame number, as a slice."""
    ends = [int(end) if end else None for end in text.split(":")]
    if len(ends) == 1 and ends[0] is not None:
        ends = [ends[0], ends[0] + 1]
    if not 2 <= len(ends) <= 3 or any(end is not None and end < 0 for end in ends):
        raise ValueError
    if len(ends) == 3 and ends[2] == 0:
        raise ValueError
    return slice(*ends)


@_expecting("no number of metres")
def voxel_edge(text: str) -> float:
    """Return the edge of a voxel, m."""
    edge = float(text)
    check_number("the edge of a voxel, m,", edge, *VOXEL_EDGES)
    return edge


@_expecting(
    "neither auto, audio nor frames by camera; expected e.g. cam03=5,cam01=-2, each camera once"
)
def parse_sync(text: str) -> str | dict[str, Any]:
    """Return `auto`, `audio`, or `cam03=5,cam01=-2.5*1.005` as a mapping."""
    if text in ("auto", "audio"):
        return text
    pairs = [item.rsplit("=", 1) for item in text.split(",")]
    parts = [(name, [float(n) for n in by.split("*")]) for name, by in pairs]
    delays = {name: (numbers[0], [*numbers, 1.0][1]) for name, numbers in parts}
    if len(delays) < len(pairs) or any(len(numbers) > 2 for _, numbers in parts):
        raise ValueError
    return join_delays(delays)


def _write_sync(sync: str | Mapping[str, Any]) -> str:
    if isinstance(sync, str):
        return sync
    delays = split_delays(sync).items()
    return ",".join(
        f"{n}={by:g}" + (f"*{speed:.9g}" if speed != 1 else "") for n, (by, speed) in delays
    )


@_expecting("no frame rate; expected e.g. 30, 29.97 or 30000/1001")
def _frame_rate(text: str) -> float:
    over, _, under = text.partition("/")
    return float(over) / float(under or 1)


@_expecting("no box; expected x0,x1,y0,y1,z0,z1 in metres")
def _parse_box(text: str) -> Any:
    """Return `x0,x1,y0,y1,z0,z1` as [[x0, y0, z0], [x1, y1, z1]], and `own:...` as {"own": that
    list}."""
    x0, x1, y0, y1, z0, z1 = map(float, text.removeprefix("own:").split(","))
    box = [[x0, y0, z0], [x1, y1, z1]]
    return {"own": box} if text.startswith("own:") else box


def _write_box(box: Any) -> str:
    own = isinstance(box, Mapping)
    low, high = box["own"] if own else box
    numbers = [repr(float(end)) for ends in zip(low, high, strict=True) for end in ends]
    return ("own:" if own else "") + ",".join(numbers)


@_expecting(f"no grid; expected NX,NY,NZ, 1 to {_MOST_ALONG} along each axis")
def _grid_shape(text: str) -> tuple[int, int, int]:
    nx, ny, nz = map(int, text.split(","))
    if min(nx, ny, nz) < 1 or max(nx, ny, nz) > _MOST_ALONG:
        raise ValueError
    return nx, ny, nz


@_expecting("no wand; expected M or M,M")
def _lengths(text: str) -> tuple[float, ...]:
    return tuple(map(float, text.split(",")))


@_expecting("no board; expected as 7x5")
def _squares(text: str) -> tuple[int, int]:
    columns, rows = map(int, text.lower().split("x"))
    return columns, rows


@_expecting("no frame; expected a number or all")
def _frame_or_all(text: str) -> int | str:
    return text if text == "all" else int(text)


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(","))


#: Texts of the sequence's flags that are more than a number, a text or a choice.
CAPTURE_TEXTS = {
    "calibration": (path_or_name, lambda path: str(resolve_path(path))),
    "fps": (_frame_rate, None),
    "sync": (parse_sync, _write_sync),
    "volume": (_parse_box, _write_box),
    "cameras": (_names, None),
}  # fmt: skip
SEQUENCE = Group("sequence", "facts that the files do not state, also keys of FOLDER/sequence.toml")
FOOTAGE, LENSES = Group("footage"), Group("cameras and world")
TARGET = Group("target", "one of --board, --wand, --c3d, --person and --refine")

CAPTURE = Part(SEQUENCE, texts=CAPTURE_TEXTS)
DEVICE = Flag(
    "where to compute: any part of a name that `psfs devices` lists, gpu:1 for the second GPU, or "
    "numpy for the reference implementation (default: auto)",
    "auto|gpu|cpu|numpy|NAME",
)
OVERWRITE = Flag("replace FILE even if it was not written by this program", saved=False)
ALL_CAMERAS = Flag(
    "keep cameras whose silhouettes disagree with the others' (default: left out, with a warning; "
    "--cameras states which to take)"
)
#: Range of the height of somebody who calibrates, m.
STATURE = Field(ge=0.3, le=3)
FRAMES = Flag("frames counted from 0, b excluded", "a:b", frame_range)
PRESET = Flag(
    "settings that are exactly a paper's; flags and --config beat them (docs/tracking.md)",
)
FIELD_OF_VIEW = (
    "of --person without --intrinsics: the angle of view of the pictures' longer side, degrees, "
    "from which the focal lengths are refined (default: by the metadata of the footage, such as "
    "iPhones write, refined likewise)"
)


def output_flag(help: str, metavar: str = "OUT") -> Flag:
    """Return the flag -o, the path of the results."""
    return Flag(help, metavar, short="-o", saved=False)


def folder_flag(help: str, metavar: str = "FOLDER", nargs: str = "") -> Flag:
    """Return a positional folder or file."""
    return Flag(help, metavar, positional=True, nargs=nargs)


class CaptureRequest(Request):
    """What the files of a sequence do not state, and the device."""

    capture: Annotated[SequenceSettings, CAPTURE] = part(SequenceSettings)
    device: Annotated[str, DEVICE] = "auto"


class FolderRequest(CaptureRequest):
    """A folder with calibrated views."""

    folder: Annotated[Path, folder_flag("folder with calibrated views")]

    def check_folders(self) -> None:
        """Raise MissingFileError, as opening the sequence would, if the folder is missing."""
        check_folder(self.folder)


class TakeRequest(CaptureRequest):
    """Frames of a sequence, and how silhouettes and voxels are made of them. REACH: px, the
    `reach` of `OccupancyConfig` if the request states none."""

    REACH: ClassVar[float] = 0.0

    frames: Annotated[slice | None, FRAMES] = None
    voxel_size: float | None = None
    all_cameras: bool = False
    reconstruction: Annotated[ReconstructionConfig, Part(only=(), table="reconstruction")] = part(
        ReconstructionConfig
    )
    preset: str | None = None


class InfoRequest(FolderRequest):
    """The request of `psfs info`."""

    COMMAND: ClassVar = "psfs info"

    pictures: Annotated[
        bool,
        Flag("do not examine the pictures for faults, which takes seconds", name="no-pictures"),
    ] = True
    masks: Annotated[
        Path | None,
        Flag("write the examined silhouettes of all cameras, in some frames, as one picture",
             "FILE"),
    ] = None  # fmt: skip
    overwrite: Annotated[bool, OVERWRITE] = False


class PersonRequest(Request):
    """Footage of somebody who walks about, from whom cameras and times are found."""

    folder: Path | None = None
    output: Path | None = None
    stature: float | None = None
    intrinsics: Path | None = None
    field_of_view: float | None = None
    capture: SequenceSettings = part(SequenceSettings)
    device: Annotated[str, DEVICE] = "auto"
    person_settings: Annotated[PersonConfig, Part(only=(), table="person")] = part(PersonConfig)


class CalibrateRequest(PersonRequest):
    """The request of `psfs calibrate`."""

    COMMAND: ClassVar = "psfs calibrate"
    DETAILS: ClassVar = (
        ". FOLDER holds videos/, images/<camera>/, or a video or folder of pictures per "
        f"camera. OUT gets {CALIBRATION} (metres, Z up), {REPORT}, {RIG}, and a picture per camera "
        f"in {PICTURES}/: reprojection errors, where the target was seen, what to do better. "
        "Recipe: docs/calibration.md."
    )

    folder: Annotated[
        Path | None, folder_flag("footage of the board, wand or person", nargs="?")
    ] = None
    output: Annotated[Path | None, output_flag("folder")] = None
    print_board: Annotated[
        Path | None,
        Flag("write a ChArUco board to print, in its true size, and nothing else; --squares "
             "(default: 7x5) and --square (default: 0.037, an A4 page) choose it", "FILE.pdf"),
    ] = None  # fmt: skip
    board: Annotated[
        str | None,
        Flag("a board with squares; FILE: a board that Caliscope (charuco.toml), Pose2Sim "
             "(Config.toml) or OpenCV's calibration sample describes",
             "charuco|chessboard|FILE", group=TARGET, either="target"),
    ] = None  # fmt: skip
    wand: Annotated[
        tuple[float, ...] | None,
        Flag("a wand of two or three bright markers, m from each to the next: 0.5 or 0.2,0.3",
             "M|M,M", _lengths, group=TARGET, either="target"),
    ] = None  # fmt: skip
    c3d: Annotated[
        Path | None,
        Flag("a wand whose markers a motion-capture system measured; the cameras are placed in "
             "that system's frame", "FILE", group=TARGET, either="target"),
    ] = None  # fmt: skip
    refine: Annotated[
        bool,
        Flag("no target: correct the cameras of FOLDER, and estimate their sub-frame times, from "
             "the silhouettes of a moving person; the cameras are kept as they are unless "
             "held-out frames fit better", group=TARGET, either="target"),
    ] = False  # fmt: skip
    person: Annotated[
        bool,
        Flag("no target: cameras and times from the silhouettes of somebody who walks about; "
             "needs --intrinsics or --field-of-view, unless metadata state the lenses",
             group=TARGET, either="target"),
    ] = False  # fmt: skip
    stature: Annotated[
        float | None,
        Flag("height of the person of --person, m, which gives the scale (default: 1.7)", "M",
             group=TARGET), STATURE,
    ] = None  # fmt: skip
    squares: Annotated[
        tuple[int, int] | None,
        Flag("squares of the board, as 7x5, not the inner corners", "CxR", _squares,
             lambda squares: "x".join(map(str, squares)), group=TARGET),
    ] = None  # fmt: skip
    square: Annotated[float | None, Flag("side of a square, m", "M", group=TARGET)] = None
    marker: Annotated[
        float | None,
        Flag("side of a ChArUco board's markers, m (default: 3/4 of a square)", "M", group=TARGET),
    ] = None
    dictionary: Annotated[
        str,
        Flag("markers of a ChArUco board (default: those that are seen)", group=TARGET,
             choices=("auto", *DICTIONARIES)),
    ] = "auto"  # fmt: skip
    boards: Annotated[
        int,
        Flag("number of ChArUco boards of these squares, whose markers are numbered on from one "
             "to the next, as --print-board writes them (default: 1)", "N", group=TARGET),
        Field(ge=1, le=20),
    ] = 1  # fmt: skip
    markers: Annotated[
        tuple[str, ...] | None,
        Flag("names of the wand's markers in the C3D file, along it (default: all of the file)",
             "A,B[,C]", lambda text: tuple(text.split(",")), group=TARGET),
    ] = None  # fmt: skip
    c3d_begins: Annotated[
        float,
        Flag("s after the first picture at which the C3D file begins (default: 0)", "S",
             group=TARGET),
    ] = 0.0  # fmt: skip
    up: Annotated[
        str | None,
        Flag("up axis of the C3D file: z, -z, y, -y, x or -x (default: z)", "AXIS", group=TARGET),
    ] = None
    intrinsics: Annotated[
        Path | None,
        Flag("intrinsics that are kept: a calibration, or a folder with a video or pictures of "
             "the board per camera (default: estimated with the rest); of --person also a folder "
             "with a photo by each camera, whose EXIF states a focal length, which is refined",
             "PATH", group=LENSES),
    ] = None  # fmt: skip
    field_of_view: Annotated[float | None, Flag(FIELD_OF_VIEW, "DEG", group=LENSES)] = None
    floor: Annotated[
        slice | None,
        Flag("frame, or a:b, in which the board or wand lies on the floor: Z = 0, X along it "
             "(default: Z is the cameras' mean up, with a warning)", "FRAME", frame_range,
             group=LENSES),
    ] = None  # fmt: skip
    height: Annotated[
        float,
        Flag("of the target's points above the floor, such as the radius of markers (default: 0)",
             "M", group=LENSES), Field(ge=-10, le=10),
    ] = 0.0  # fmt: skip
    frames: Annotated[
        slice | None,
        Flag(f"frames counted from 0, b excluded (default: all, at most "
             f"{MOST_TARGET_FRAMES}, evenly spread)", "a:b", frame_range,
             group=FOOTAGE),
    ] = None  # fmt: skip
    capture: Annotated[
        SequenceSettings,
        Part(FOOTAGE, only=("cameras", "fps", "sync", "calibration"), texts=CAPTURE_TEXTS),
    ] = part(SequenceSettings)


class ConvertRequest(FolderRequest):
    """The request of `psfs convert`."""

    COMMAND: ClassVar = "psfs convert"
    DETAILS: ClassVar = (
        ": calibration.toml in metres with Z up, sequence.toml, and copies of the pictures "
        "named after their cameras. What the flags state is part of it. With --to, the calibration "
        "alone, for another program."
    )

    output: Annotated[Path, output_flag("new folder", "NATIVE")]
    to: Annotated[
        str | None,
        Flag(f"write the calibration only, as this program has it: {', '.join(FORMATS)}",
             "FORMAT", choices=FORMATS),
    ] = None  # fmt: skip


class ReconstructRequest(FolderRequest, TakeRequest):
    """The request of `psfs reconstruct`."""

    COMMAND: ClassVar = "psfs reconstruct"
    PRESETS: ClassVar[Presets] = PRESETS
    DETAILS: ClassVar = (
        ". OUT gets clouds/frame_NNNNNN.ply and .npz, summary.json and preview.png. "
        "Without a stated volume it is found from the cameras and the first silhouettes."
    )

    output: Annotated[
        Path | None, Flag("new folder", "OUT", short="-o", saved=False, required=True)
    ] = None
    grid: Annotated[
        tuple[int, int, int] | None,
        Flag("number of voxels along each axis", "NX,NY,NZ", _grid_shape, either="size"),
    ] = None
    voxel_size: Annotated[
        float | None, Flag("edge of a voxel, metres", "M", voxel_edge, either="size")
    ] = None
    debris: Annotated[
        float,
        Flag("drop connected parts smaller than this share of the largest one (default "
             f"{DEBRIS_SHARE:g}; 0 keeps everything, 1 only the largest)", "SHARE"),
        Field(ge=0, le=1),
    ] = DEBRIS_SHARE  # fmt: skip
    colour: Annotated[
        bool, Flag("do not colour the clouds from the pictures", name="no-colour")
    ] = True
    normals: Annotated[bool, Flag("write the surface's normals into the PLY")] = False
    track: Annotated[
        Path | None,
        Flag("use a track of the same frames (a folder of `apf track`, or its npz) as a prior of "
             "the voxels: limbs that silhouettes miss stay", "OUT"),
    ] = None  # fmt: skip
    all_cameras: Annotated[bool, ALL_CAMERAS] = False
    preset: Annotated[str | None, PRESET] = None


class SilhouettesRequest(FolderRequest, TakeRequest):
    """The request of `psfs silhouettes`."""

    COMMAND: ClassVar = "psfs silhouettes"
    PRESETS: ClassVar[Presets] = PRESETS
    DETAILS: ClassVar = (
        ". OUT gets frame_NNNNNN.png, a row per camera: picture, likelihood, silhouette; "
        "where FOLDER has truth_masks/CAMERA_NNNNNN.png also what is missed (red) and too much "
        f"(green); and {SILHOUETTES}. All frames before those shown are reconstructed, since "
        f"silhouettes learn from them. Shown by default: frames with true masks, else {SHOWN} "
        "spread over the sequence."
    )

    output: Annotated[Path, output_flag("folder")]
    preset: Annotated[str | None, PRESET] = None


class RunRequest(Request):
    """A run of `psfs reconstruct`, and the device."""

    out: Annotated[Path, folder_flag("output folder of psfs reconstruct", "OUT")]
    device: Annotated[str, DEVICE] = "auto"


class CheckRequest(RunRequest):
    """The request of `psfs check`."""

    COMMAND: ClassVar = "psfs check"
    DETAILS: ClassVar = f". {DEFINITION}. Writes OUT/check.json."


class MeshRequest(RunRequest):
    """The request of `psfs mesh`."""

    COMMAND: ClassVar = "psfs mesh"
    DETAILS: ClassVar = (
        ", coloured where the clouds are. The probability is computed again from the "
        "frames' pictures. In metres; PLY with Z up, OBJ and GLB with Y up."
    )

    frame: Annotated[
        int | str | None,
        Flag("frame to mesh (default: the first that is not empty)", "N|all", _frame_or_all),
    ] = None
    output: Annotated[
        Path | None, output_flag("file, or folder for --frame all (default: in OUT/meshes)", "PATH")
    ] = None
    overwrite: Annotated[bool, OVERWRITE] = False
    format: Annotated[
        str | None, Flag("default: the output's suffix, or ply", choices=MESH_FORMATS)
    ] = None
    smooth: Annotated[
        int,
        Flag(f"smoothing steps, which do not shrink (default {SMOOTHING}; 0: none)", "N"),
        Field(ge=0, le=MOST_SMOOTHING),
    ] = SMOOTHING
    check: Annotated[
        bool,
        Flag(f"say whether the mesh is watertight, and the {MESH_DEFINITION}; writes "
             "OUT/mesh_check.json"),
    ] = False  # fmt: skip


class PageRequest(Request):
    """A page in the browser."""

    port: Annotated[
        int, Flag("port on 127.0.0.1 (default: 8090)", "N"), Field(ge=0, le=65535)
    ] = 8090  # fmt: skip
    browser: Annotated[bool, Flag("print the address, and open no browser", name="no-browser")] = (
        True
    )


class ViewRequest(RunRequest, PageRequest):
    """The request of `psfs view`."""

    COMMAND: ClassVar = "psfs view"
    DETAILS: ClassVar = (
        ". Keys of the page: space plays or pauses, J and L step, Home and End, Page Up and "
        "Page Down change the speed, 1 to 9 show and hide, V changes the colours, R looks from the "
        "start, I is dark or light; the arrows, W, A, S, D, Q and E move the view."
    )

    frame: Annotated[
        int | None, Flag("frame to show (default: the first that is not empty)", "N")
    ] = None
    mesh: Annotated[bool, Flag("show the surfaces of psfs mesh")] = False
    png: Annotated[Path | None, Flag("write a picture, open no page", "FILE")] = None
    overwrite: Annotated[bool, OVERWRITE] = False


class DevicesRequest(Request):
    """The request of `psfs devices`."""

    COMMAND: ClassVar = "psfs devices"
