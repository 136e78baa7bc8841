"""The requests of `apf`: what API, commands, batches, studio and cluster ask for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field
from pydantic.fields import FieldInfo

from apf.cluster import CORES_BESIDE_GPU, PER_GPU
from apf.evaluation import MARKER_SETS
from apf.filters.method import Method
from apf.filters.searches import OBJECTIVES, SEARCHES
from apf.filters.term_weights import TERMS, USUAL_TERMS, list_comparing_weights, parse_weights
from apf.formats import AXES
from apf.image_objective.config import ObjectiveConfig
from apf.live.config import LiveConfig
from apf.presets import PRESETS
from apf.report import PAGE
from apf.synthetic.config import SceneConfig
from apf.tracking.config import (
    EXPORTS,
    MESHES,
    OF_POINTS,
    OPENSIM,
    USD,
    SmoothingConfig,
    TriangulatedConfig,
)
from cl import InputError
from psfs import request as of_psfs
from psfs.common.config import Config, SettingError, field_choices, part
from psfs.common.ranges import LARGEST
from psfs.common.requests import (
    Flag,
    Group,
    Option,
    Part,
    Presets,
    Request,
    Stated,
    list_options,
    refuse_unused,
    set_flags,
)
from psfs.footage.settings import SequenceSettings
from psfs.request import (
    ALL_CAMERAS,
    CALIBRATION,
    CAPTURE_TEXTS,
    DEVICE,
    FIELD_OF_VIEW,
    FOOTAGE,
    PRESET,
    REPORT,
    SEQUENCE,
    STATURE,
    FolderRequest,
    PageRequest,
    TakeRequest,
    file_or_name,
    folder_flag,
    output_flag,
    path_or_name,
    voxel_edge,
)

#: The value of --method by which keypoints alone are triangulated, without a body.
TRIANGULATE = "triangulate"
START = Group("start", "person and first pose")
SEARCH = Group("search", "search and objective")
SHAPE = Group("shape", "how the body looks in pictures")
KEYPOINTS = Group("keypoints", "2-D points of any pose network")
WORKERS = Group("workers", "a process each, which does one take at a time")

#: Settings of the body's shape in pictures that have a flag of their own, besides --shape.
_OF_SHAPES = ("mesh_weights", "mesh_pose", "round_ends")
#: Weights that both the voxels' likelihood and the image objectives have.
_WEIGHTS = ("edge_weight", "silhouette_weight")
#: Flags that apply only to pictures, but those of the method.
_OF_PICTURES = (*_WEIGHTS, "voxel_size", "all_cameras")
_SHAPE_TEXTS = {"mesh_weights": (file_or_name, None), "mesh_pose": (file_or_name, None)}
_SHAPE_DEFAULTS = {
    "mesh_weights": "the nearest cone's",
    "mesh_pose": "the body's rest",
    "round_ends": "off",
}
_FRUSTA = ", ".join(map(str, field_choices(ObjectiveConfig.model_fields["vertices_per_part"])[1:]))

_SHAPE_FLAG = Flag(
    "vertices per part: 4 for trapezoids, 8 for square frusta, more for elliptic ones "
    f"({_FRUSTA}); or a mesh of the person, metres, that trimesh reads, made for the body of "
    "--body (default: 4)",
    "N|FILE",
    file_or_name,
    group=SHAPE,
)


def _method_default(path: tuple[str, ...], info: FieldInfo) -> str:
    """Return a default as --help shows it: one value, or one per method if they differ."""
    name = path[-1]
    if name in _SHAPE_DEFAULTS:
        return _SHAPE_DEFAULTS[name]
    others = [f"{s.defaults[name]} with {s.name}" for s in SEARCHES.values() if name in s.defaults]
    if name in _WEIGHTS:
        others.append(f"{getattr(ObjectiveConfig(), name)} with image features")
    return ", ".join([str(info.default), *others])


def _method_part(more: str = "", one_way: bool = False) -> Part:
    """Return how a method is written in flags. more: further methods of the command."""
    extra = {
        "method": Flag(
            "; ".join(f"{search.name}: {search.meaning}" for search in SEARCHES.values())
            + f"{more} (default: apf)",
            "METHOD", group=SEARCH, choices=(*SEARCHES, *([TRIANGULATE] if one_way else ())),
        ),
        "objective": Flag(
            f"{', '.join(OBJECTIVES)}: the voxels' likelihood, or functions of image features, "
            "which need no reconstruction (default: voxel)", "OBJECTIVE", group=SEARCH,
            choices=tuple(OBJECTIVES),
        ),
        "likelihood": Flag(
            f"terms of the voxels' likelihood out of {', '.join(TERMS)}, each with its weight if "
            "it is not the usual one; Song et al.'s is edge=1,silhouette; contour and part_colour "
            f"need pictures (default: {','.join(USUAL_TERMS)}, and silhouette_recall where limbs "
            "are searched for)", "A,B=W", group=SEARCH,
        ),
    }  # fmt: skip
    if one_way:
        extra["one_way"] = Flag(
            "track forward alone, as live: in about half of the time, less accurately"
        )
    extra["shape"] = _SHAPE_FLAG
    groups = dict.fromkeys(_OF_SHAPES, SHAPE)
    return Part(
        SEARCH, table="method", texts=_SHAPE_TEXTS, default=_method_default, extra=extra,
        groups=groups,
    )  # fmt: skip


def shape_settings(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of an ObjectiveConfig that --shape sets. Raises InputError if another
    flag applies only to a mesh and --shape names none."""
    shape = values.get("shape")
    try:
        settings = {} if shape is None else {"vertices_per_part": int(shape), "mesh_file": ""}
    except ValueError:
        return {"mesh_file": shape}
    for name, flag in (("mesh_weights", "--shape-weights"), ("mesh_pose", "--shape-pose")):
        if values.get(name) is not None:
            raise InputError(f"{flag} applies only to a mesh; expected --shape FILE with it")
    try:
        ObjectiveConfig.from_dict(settings)
    except SettingError as error:
        raise InputError(f"--shape{error.problem}") from None
    return settings


#: The folder of results; and that of a track, or its file.
Output = Annotated[Path, output_flag("folder")]
TrackFile = Annotated[Path, folder_flag("folder of `apf track`, or its npz", "OUT")]
#: What the files of a sequence do not state, without its rate.
Sighted = Annotated[SequenceSettings, Part(SEQUENCE, without=("fps",), texts=CAPTURE_TEXTS)]


class StartRequest(TakeRequest):
    """The person, the first pose, and the method."""

    body: Annotated[
        Any,  # a BodyModel, or its name or file
        Flag("body model: a TOML file or a shipped name (default: song32, or the sequence's own)",
             "B", file_or_name, group=START),
    ] = None  # fmt: skip
    init: Annotated[
        Any,  # a pose (D,), or a file
        Flag("first pose: a text file with a value per degree of freedom (radians, metres), or "
             "joints (npz or TRC) to whose first frame body and pose are fitted (default: the "
             "sequence's own, where it has one; else found in the first voxels)",
             "P", Path, group=START),
    ] = None  # fmt: skip
    height: Annotated[
        float | None, Flag("stature of the person, m, if it is known", "M", group=START)
    ] = None
    convention: Annotated[str, Flag("axes of a TRC (default: y-up)", group=START, choices=AXES)] = (
        "y-up"
    )
    voxel_size: Annotated[
        float | None, Flag("edge of a voxel, m", "M", voxel_edge, group=START)
    ] = None
    method: Annotated[Method, _method_part()] = part(Method)

    @classmethod
    def make_part(cls, name: str, stated: Stated) -> Config:
        """Return the settings of a part as files and flags state them. Raises InputError."""
        return _make_method(cls, stated) if name == "method" else super().make_part(name, stated)


def _make_method(kind: type[Request], stated: Stated) -> Method:
    """Return the method of files and flags. Raises InputError, also for a flag that does not apply
    to it."""
    values = stated.values
    method = _base_method(stated)
    _refuse_others(kind, stated, method)
    shape = shape_settings(values)
    if values.get("likelihood") is not None:
        terms = _parse_terms(values["likelihood"])
        method = method.replace(filter=method.filter.with_changes(**terms))
    if shape:
        method = method.replace(image=method.image.replace(**shape))
    others = ("filter.likelihood",) if method.uses_images else ("image", "features")
    method = set_flags(kind, "method", method, values, others)
    return method.replace(both_ways=method.both_ways and not values.get("one_way", False))


def _base_method(stated: Stated) -> Method:
    """Return the method whose settings the flags change: that of the files, unless a flag names
    another one, else the defaults of the selected one."""
    search, objective = stated.values.get("method"), stated.values.get("objective")
    if search == TRIANGULATE:
        return Method()
    base = stated.read_table("method", Method)
    if base is None:
        return Method.create(search or "apf", objective or "voxel")
    objective = objective or base.objective
    if search in (None, base.search):
        return base.replace(objective=objective)
    if "method" not in stated.tables:  # a preset changes only the settings that it names
        named = {"search": search, "objective": objective}
        return Method.from_dict({**stated.preset["method"], **named}, "method")
    return Method.create(str(search), objective)


def _refuse_others(kind: type[Request], stated: Stated, method: Method) -> None:
    """Raise InputError for a flag that does not apply to the method."""
    if stated.values.get("method") == TRIANGULATE:
        return
    paths = {o.dest: o.paths[0][0] for o in list_options(kind) if o.part == "method" and o.paths}
    owners: dict[str, tuple[str, ...]] = {
        "apf": ("trunk_layers",),
        "pso": tuple(dest for dest, room in paths.items() if room == "swarm"),
        "sir": tuple(dest for dest, room in paths.items() if room == "sir"),
        TRIANGULATE: ("low_pass", "max_error", "longest_gap"),
    }
    for owner, dests in owners.items():
        if method.search != owner:
            why = f"applies only to --method {owner}; this one is {method.search}"
            refuse_unused(kind, stated.chosen, dests, why)
    none = f"expected none with --objective {method.objective}"
    of_images = [d for d, room in paths.items() if room in ("image", "features")]
    if not method.uses_images:
        dests = tuple({*of_images, "shape"} - {*_WEIGHTS})
        refuse_unused(kind, stated.chosen, dests, f"applies only to image objectives; {none}")
    if not method.uses_voxels:
        dests = ("likelihood", "surface_weight")
        refuse_unused(kind, stated.chosen, dests, f"applies only to the voxels; {none}")
    if method.objective == "keypoints":
        refuse_unused(kind, stated.chosen, _OF_PICTURES, f"applies only to pictures; {none}")


def _parse_terms(text: str) -> dict[str, float]:
    """Parse the weights of --likelihood. Raises InputError if it names a term twice, or if no term
    that compares the body with observations has a weight."""
    terms = parse_weights(text)
    names = [term.partition("=")[0].strip() for term in text.split(",")]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice:
        raise InputError(f"--likelihood {text}: {twice} is there twice; expected each term once")
    if not any(terms.values()):
        raise InputError(f"--likelihood {text}: no term has a weight; expected one at least")
    if not any(terms[weight] for weight in list_comparing_weights()):
        raise InputError(
            f"--likelihood {text}: none of these terms compares the body with anything that is "
            f"seen; expected one of {', '.join(list_comparing_weights().values())}, too"
        )
    return terms


def _people(text: str) -> int | str:
    return int(text) if text.isdecimal() else text


class TrackingRequest(StartRequest):
    """Takes, and all of their tracking. people: how many are tracked, "auto" for as many as are
    seen."""

    PRESETS: ClassVar[Presets] = PRESETS
    REACH: ClassVar[float] = 1.0

    folders: Annotated[tuple[Path, ...], folder_flag("folder with calibrated views", nargs="+")]
    output: Annotated[
        Path | None,
        Flag("folder for the results; of several takes each has its own in it, by its name", "OUT",
             short="-o", saved=False, required=True),
    ] = None  # fmt: skip
    all_cameras: Annotated[bool, ALL_CAMERAS] = False
    method: Annotated[
        Method,
        _method_part(f"; {TRIANGULATE}: --keypoints alone, triangulated, without a body", True),
    ] = part(Method)
    keypoints: Annotated[
        Any,  # Keypoints, or their path
        Flag("keypoints in all cameras, in FOLDER or anywhere: keypoints.npz, OpenPose's JSON "
             "(Pose2Sim, Sports2D), OpenCap's pickles, FreeMoCap's arrays, DeepLabCut's tables; "
             "PATH may hold wildcards (default: none, even where there are some)",
             "PATH", path_or_name, group=KEYPOINTS),
    ] = None  # fmt: skip
    triangulated: Annotated[TriangulatedConfig, Part(KEYPOINTS)] = part(TriangulatedConfig)
    seeds: Annotated[
        int | None,
        Flag("make N runs at once, with seeds from --seed on, into OUT/seed0 and so on, and say "
             "how far they differ", "N"),
    ] = None  # fmt: skip
    people: Annotated[
        int | str,
        Flag("track N people, each into OUT/person1 and so on; auto: as many as are seen, a "
             "single one into OUT itself (default: auto)", "N", _people),
    ] = "auto"  # fmt: skip
    preset: Annotated[str | None, PRESET] = None
    video: Annotated[bool, Flag("write no overlay.mp4", name="no-overlay")] = True
    report: Annotated[
        bool,
        Flag(f"write no {PAGE}, and leave the track uncompared with the silhouettes",
             name="no-report"),
    ] = True  # fmt: skip

    @property
    def folder(self) -> Path:
        """The folder of the take, or of the first."""
        return self.folders[0]

    @property
    def triangulate(self) -> bool:
        """Whether keypoints alone are triangulated, without a body."""
        return self._stated is not None and self._stated.values.get("method") == TRIANGULATE

    def value(self, option: Option) -> Any:
        """Return the value of a flag."""
        alone = option.dest == "method" and self.triangulate
        return TRIANGULATE if alone else super().value(option)


class TrackRequest(TrackingRequest):
    """The request of `apf track`, `apf.track` and `apf.track_people`."""

    COMMAND: ClassVar = "apf track"

    corrections: Annotated[
        Path | None,
        Flag("corrections of a track by hand (TOML, as the page of apf studio writes them): parts "
             "of it are tracked again from the corrected frames, the rest stays as it is", "FILE"),
    ] = None  # fmt: skip

    def batch(self) -> BatchRequest:
        """Return the request of `apf batch` for several takes, which are not exported."""
        stated = self.stated.only(BatchRequest)
        return BatchRequest.from_stated(replace(stated, values={**stated.values, "to": ()}))


class BatchRequest(TrackingRequest):
    """The request of `apf batch`."""

    COMMAND: ClassVar = "apf batch"

    workers: Annotated[
        int | None,
        Flag(f"on this machine (default: for each GPU {PER_GPU}, or as many as "
             f"there are {CORES_BESIDE_GPU} cores each; without GPU one for each core)",
             "N", group=WORKERS, either="workers"),
    ] = None  # fmt: skip
    scheduler: Annotated[
        str | None,
        Flag("those of a running Dask cluster: tcp://HOST:PORT, or its scheduler file", "ADDRESS",
             group=WORKERS, either="workers"),
    ] = None  # fmt: skip
    part_frames: Annotated[
        int | None,
        Flag("cut longer takes into overlapping parts of about so many frames, which are tracked "
             "at the same time and joined where they agree best (default: not cut)", "N"),
        Field(ge=2, le=LARGEST),
    ] = None  # fmt: skip
    to: Annotated[
        tuple[str, ...],
        Flag(f"export each take as `apf export` does: {', '.join(EXPORTS)} (default: all; --to "
             "alone: none)", "FORMAT", nargs="*", choices=tuple(EXPORTS)),
    ] = tuple(EXPORTS)  # fmt: skip


class LiveRequest(StartRequest):
    """The request of `apf live`. people: None for one, with a warning if there are more."""

    COMMAND: ClassVar = "apf live"

    folder: Annotated[Path, folder_flag("folder with calibrated views")]
    output: Output
    capture: Sighted = part(SequenceSettings)
    captures: Annotated[
        tuple[str, ...] | None,
        Flag("cameras in the order of the calibration that lies in FOLDER (or that FOLDER is): USB "
             "numbers, URLs or videos (default: play the recording in FOLDER at its own rate)",
             "C", nargs="+"),
    ] = None  # fmt: skip
    empty: Annotated[
        float,
        Flag("seconds of the empty scene that --captures begin with, unless FOLDER/background "
             "shows it (default: 2)", "S"), Field(ge=0, le=600),
    ] = 2.0  # fmt: skip
    budget: Annotated[
        float | None,
        Flag("poses per second to be reached, by a search of the size that allows it (default: as "
             "many as frames if that leaves time for a good search, unless --particles or "
             "--layers says a size)", "N", name="fps"), Field(ge=0.1, le=1000),
    ] = None  # fmt: skip
    people: Annotated[
        int | str | None,
        Flag("track N people, each into OUT/person1 and so on, from one reconstruction; auto: as "
             "many as the recording shows; with --captures from --init with the joints of all, in "
             "--volume (default: 1, with a warning if the recording begins with more)", "N",
             _people),
    ] = None  # fmt: skip
    truth: Annotated[Path | None, Flag("true joints (npz or TRC): to state the error", "F")] = None
    scale: Annotated[
        float | None,
        Flag("size of the pictures that are looked at, up to 1 (default: on a CPU as small as "
             "pixels still are no larger than voxels, else 1)", "S"), Field(ge=0.05, le=1),
    ] = None  # fmt: skip
    studio: Annotated[
        bool,
        Flag("show the body, latency and dropped frames on a page in the browser, see apf studio"),
    ] = False
    send: Annotated[
        tuple[str, ...] | None,
        Flag("send each pose at once: vmc (VSeeFace, Warudo, Unreal, Blender), osc, websocket or "
             "lsl, also as vmc:HOST:PORT", "KIND", nargs="+"),
    ] = None  # fmt: skip
    live: Annotated[LiveConfig, Part(only=(), table="live")] = part(LiveConfig)

    @property
    def states_noise(self) -> bool:
        """Whether the search's noise is stated, rather than that of `live`."""
        stated = self._stated
        return stated is not None and ("noise" in stated.values or "method" in stated.tables)


class SynthRequest(Request):
    """The request of `apf synth`."""

    COMMAND: ClassVar = "apf synth"

    output: Annotated[Path, output_flag("folder", "FOLDER")]
    scene: Annotated[SceneConfig, Part(default=lambda path, info: _scene_default(info), fill=True,
        texts={"size": (lambda text: _size(text), lambda size: "x".join(map(str, size)))})
    ] = part(SceneConfig)  # fmt: skip
    device: Annotated[str, DEVICE] = "auto"


def _scene_default(info: FieldInfo) -> str:
    default = info.default
    return "x".join(map(str, default)) if isinstance(default, tuple) else f"{default}"


def _size(text: str) -> tuple[int, int]:
    """Parse `640x480` to (640, 480)."""
    try:
        width, height = (int(number) for number in text.lower().split("x"))
    except ValueError:
        raise InputError(f"{text!r} is no picture size; expected WxH, such as 640x480") from None
    return width, height


class DemoRequest(Request):
    """The request of `apf demo`."""

    COMMAND: ClassVar = "apf demo"

    output: Annotated[Path, output_flag("folder (default: demo)", "FOLDER")] = Path("demo")
    scene: Annotated[SceneConfig, Part(only=("frames", "cameras"), fill=True)] = part(
        SceneConfig, frames=30, seed=2
    )
    open: Annotated[bool, Flag("open the report in a browser at the end")] = False
    device: Annotated[str, DEVICE] = "auto"


class TimingsRequest(Request):
    """The request of `apf timings`."""

    COMMAND: ClassVar = "apf timings"
    DETAILS: ClassVar = (
        ": milliseconds per frame of reconstruction, colour and tracking (Song et al. 2012: eight "
        "cameras of 640 x 480, 150 x 150 x 100 voxels, 200 particles, 10 layers) in NumPy, in "
        "OpenCL on one core and on all cores, and on every GPU. OUT gets timings.json and "
        "timings.png."
    )

    output: Annotated[Path, output_flag("folder (default: timings)", "OUT")] = Path("timings")
    seconds: Annotated[
        float, Flag("measure for about so long, s", "S"), Field(ge=1, le=3600)
    ] = 60.0  # fmt: skip


class CalibrateRequest(of_psfs.PersonRequest):
    """The request of `apf calibrate`."""

    COMMAND: ClassVar = "apf calibrate"
    DETAILS: ClassVar = (
        ". FOLDER holds videos/ or images/<camera>/ of somebody who walks about, and "
        f"background/ where there is one. OUT gets {CALIBRATION} (metres, Z up) and {REPORT}. See "
        "docs/calibration.md; without keypoints: psfs calibrate --person."
    )

    folder: Annotated[Path, folder_flag("footage of the person")]
    output: Output
    keypoints: Annotated[
        str | None,
        Flag("keypoints in all cameras, of any program that apf track --keypoints reads "
             "(required)", "PATH", path_or_name),
    ] = None  # fmt: skip
    intrinsics: Annotated[
        Path | None,
        Flag("intrinsics that are kept: a calibration, of which only the lenses are taken; or a "
             "folder with a photo by each camera, whose EXIF states a focal length, which is "
             "refined", "PATH"),
    ] = None  # fmt: skip
    field_of_view: Annotated[float | None, Flag(FIELD_OF_VIEW, "DEG", group=Group("lenses"))] = None
    stature: Annotated[
        float | None,
        Flag("height of the person, m, which gives the scale (default: 1.7)", "M"), STATURE,
    ] = None  # fmt: skip
    silhouettes: Annotated[
        bool,
        Flag("keep what the keypoints say (default: adjusted to the silhouettes, and refused if "
             "these do not fit)", name="no-silhouettes"),
    ] = True  # fmt: skip
    capture: Annotated[
        SequenceSettings, Part(FOOTAGE, only=("cameras", "fps"), texts=CAPTURE_TEXTS)
    ] = part(SequenceSettings)


class KeypointsRequest(FolderRequest):
    """The request of `apf keypoints`."""

    COMMAND: ClassVar = "apf keypoints"

    output: Annotated[
        Path,
        output_flag("folder for OUT/<camera>_json/<camera>_000000.json, as Pose2Sim has them"),
    ]
    capture: Sighted = part(SequenceSettings)
    at_once: Annotated[
        int | None, Flag("cameras at a time (default: as many as cores)", "N"),
        Field(ge=1, le=LARGEST),
    ] = None  # fmt: skip
    crop: Annotated[
        bool,
        Flag("show whole pictures to the network (default: cropped by the silhouette, where the "
             "empty scene is known)", name="no-crop"),
    ] = True  # fmt: skip
    people: Annotated[
        int | str,
        Flag("people to find in each picture: a number, or auto for as many as are seen in "
             "silhouettes (default 1); each where they stand", "N", _people),
    ] = 1  # fmt: skip


class BodyRequest(Request):
    """The request of `apf body`."""

    COMMAND: ClassVar = "apf body"
    DETAILS: ClassVar = ": bones, cones and joints, or what does not work with it alone."

    action: Annotated[
        Literal["show", "check"], Flag("what to do", positional=True, metavar="show|check")
    ]
    file: Annotated[str, folder_flag("a shipped body or a TOML file, docs/formats.md", "BODY")]


class SmoothRequest(Request):
    """The request of `apf smooth`."""

    COMMAND: ClassVar = "apf smooth"

    track: Annotated[Path, folder_flag("folder that `apf track` wrote", "TRACK")]
    output: Output
    smoothing: Annotated[SmoothingConfig, Part(only=("cutoff", "lag"), fill=True)] = part(
        SmoothingConfig
    )


class ExportRequest(Request):
    """The request of `apf export`."""

    COMMAND: ClassVar = "apf export"

    track: TrackFile
    to: Annotated[
        tuple[str, ...] | None,
        Flag(f"{', '.join(EXPORTS)} (default: all; of a track without a body "
             f"{', '.join(OF_POINTS)}), or {OPENSIM}: a scaled OpenSim model and its inverse "
             f"kinematics, {USD}: the person's surface, {' or '.join(MESHES)}: that of each frame",
             "FORMAT", nargs="+", choices=(*EXPORTS, OPENSIM, USD, *MESHES)),
    ] = None  # fmt: skip
    osim_model: Annotated[
        Path | None,
        Flag(f"the model that --to {OPENSIM} scales (default: the one that Pose2Sim carries)",
             "FILE"),
    ] = None  # fmt: skip
    output: Annotated[
        Path | None, output_flag("where to (default: beside the track)", "FOLDER")
    ] = None
    axes: Annotated[
        str,
        Flag("of the TRC: y-up (X Y Z) = world (x z -y), z-up = world (x y z), pose2sim = world "
             "(y z x) (default: y-up)", choices=AXES),
    ] = "y-up"  # fmt: skip
    smoothing: Annotated[SmoothingConfig, Part(only=("cutoff",), fill=True)] = part(SmoothingConfig)
    raw: Annotated[bool, Flag("the poses as they were tracked, without smoothing")] = False


class EvaluateRequest(Request):
    """The request of `apf evaluate`."""

    COMMAND: ClassVar = "apf evaluate"

    track: TrackFile
    truth: Annotated[
        tuple[Path, ...],
        Flag("npz, TRC or C3D; of several people one npz of all, or a file for each", "FILE",
             nargs="+"),
    ]  # fmt: skip
    markers: Annotated[
        str | None,
        Flag("compare markers on the body with the truth's, by their labels: a TOML file that says "
             f"where each is fixed, or {', '.join(MARKER_SETS)} (docs/formats.md)", "SET",
             file_or_name),
    ] = None  # fmt: skip
    truth_start: Annotated[
        float | None,
        Flag("frame of the truth, counted from 0, that is the sequence's frame 0; truth at "
             "another rate is taken at the frames' times (default: a C3D's own numbers)", "N"),
        Field(ge=-1e9, le=1e9),
    ] = None  # fmt: skip
    convention: Annotated[
        str | None,
        Flag("axes of a TRC or C3D: y-up (X Y Z) = world (x z -y), as `apf track` writes it; "
             "pose2sim = world (y z x); z-up = world (x y z) (default: of a TRC y-up, or another "
             "one with which it is near the track; what a C3D says)", choices=AXES),
    ] = None  # fmt: skip
    csv: Annotated[bool, Flag("write errors per frame")] = False
    plot: Annotated[bool, Flag("write a picture (PNG)")] = False
    json_file: Annotated[bool, Flag("write all figures", name="json")] = False
    output: Annotated[
        Path | None,
        output_flag("where evaluation.csv, .png and .json go (default: beside the track); all "
                    "three unless some of --csv, --plot, --json choose", "FOLDER"),
    ] = None  # fmt: skip


class ReportRequest(Request):
    """The request of `apf report`."""

    COMMAND: ClassVar = "apf report"

    track: Annotated[Path, folder_flag("folder that `apf track` wrote", "OUT")]
    video: Annotated[bool, Flag("draw no overlay that is missing", name="no-overlay")] = True
    device: Annotated[str, DEVICE] = "auto"


class RenderRequest(FolderRequest):
    """The request of `apf render`."""

    COMMAND: ClassVar = "apf render"

    track: Annotated[Path, folder_flag("folder that `apf track` wrote", "TRACK")]
    output: Output
    frames: Annotated[slice | None, of_psfs.FRAMES] = None
    look: Annotated[
        ObjectiveConfig,
        Part(SHAPE, only=_OF_SHAPES, texts=_SHAPE_TEXTS, default=_method_default,
             extra={"shape": _SHAPE_FLAG}),
    ] = part(ObjectiveConfig)  # fmt: skip
    opengl: Annotated[bool, Flag("render by OpenGL instead of OpenCL")] = False

    @classmethod
    def make_part(cls, name: str, stated: Stated) -> Config:
        """Return the settings of a part as files and flags state them. Raises InputError."""
        if name != "look":
            return super().make_part(name, stated)
        base = ObjectiveConfig(**shape_settings(stated.values))
        config: Config = set_flags(cls, name, base, stated.values)
        return config

    def value(self, option: Option) -> Any:
        """Return the value of a flag."""
        if option.dest != "shape":
            return super().value(option)
        return self.look.mesh_file or str(self.look.vertices_per_part)


class StudioRequest(PageRequest):
    """The request of `apf studio`."""

    COMMAND: ClassVar = "apf studio"

    folder: Annotated[
        Path,
        folder_flag("a take, results of apf track or psfs reconstruct, or a folder of these; the "
                    "page reads nothing outside of it (default: the current folder)", nargs="?"),
    ] = Path()  # fmt: skip
    output: Annotated[
        Path,
        output_flag("folder for runs that the page starts, each in its own (default: results)"),
    ] = Path("results")
    captures: Annotated[
        tuple[str, ...] | None,
        Flag("show these cameras live, to calibrate and film with: USB numbers, URLs or videos",
             "C", nargs="+"),
    ] = None  # fmt: skip
    device: Annotated[str, DEVICE] = "auto"


class ViewRequest(of_psfs.ViewRequest):
    """The request of `apf view`."""

    COMMAND: ClassVar = "apf view"

    out: Annotated[Path, folder_flag("output folder of apf track, or of psfs reconstruct", "OUT")]
    track: Annotated[
        Path | None,
        folder_flag("folder that `apf track` wrote, whose body is shown in the voxels of OUT",
                    "TRACK", nargs="?"),
    ] = None  # fmt: skip
