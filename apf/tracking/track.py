"""The result of tracking: poses and joints per frame, and its files."""

from __future__ import annotations

import html
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from apf.body.angles import joint_angles, standing_ankles
from apf.body.kinematics import posed_cones, posed_points
from apf.body.limbs import limb_angles, limb_bones, limb_ends, limb_joints, limb_masks
from apf.body.markers import virtual_markers
from apf.body.model import BodyModel
from apf.body.surface import Surface
from apf.body.toml import format_body, load_body, parse_body
from apf.formats.motion import BodyMotion, interpolate_gaps
from apf.formats.svg import animate_skeleton
from apf.formats.trc import CONVENTIONS, JointSeries, write_trc
from apf.formats.writers import BODY_WRITERS, WRITERS
from apf.tracking.foot_contact import detect_flat_feet, find_ankles
from apf.tracking.limb_confidence import LOST, limb_confidence
from cl import InputError
from psfs.cameras.names import join_names
from psfs.common.files import write_atomically
from psfs.common.npz import Values, get_scalar, read_npz
from psfs.common.ranges import check_number
from psfs.common.ranges import spans as spans

#: The file that lists the people of a take, see `apf.tracking.people`.
PEOPLE = "people.json"
#: The chunks of a track that is being written, ordered by name; see `part_name`.
PARTS = "parts/track_*.npz"
_DIAGNOSTIC = "diagnostic_"  # prefix of the diagnostics' keys in the npz
#: The fields of a `track.npz`, in m and rad.
_FIELDS = {
    "body_name": Values((), "text"),
    "dof_names": Values(("D",), "text"),
    "joint_names": Values(("J",), "text"),
    "fps": Values((), low=1e-3, high=1e5),
    "frames": Values(("F",), "int", low=0),
    "poses": Values(("F", "D"), low=-1e6, high=1e6),
    "joints": Values(("F", "J", 3), finite=False, low=-1e6, high=1e6),
    "edges": Values(("E", 2), "int", low=0),
    "provenance": Values((), "text"),
    "body": Values((), "text", needed=False),
}
#: The fields of a track's `Surface`.
_SURFACE = {
    "surface_pose": Values(("D",), low=-1e6, high=1e6),
    "surface_vertices": Values(("M", 3), low=-1e6, high=1e6),
    "surface_faces": Values(("T", 3), "int", low=0),
    "surface_deviation": Values(("M",), low=0, high=np.inf),
    "surface_common": Values((), low=0, high=np.inf),
    "surface_lengths": Values(("E",), low=0, high=np.inf),
    "surface_colours": Values(("C", 3), "int", low=0, high=255),
}
#: The diagnostics that later stages compute with; only these are checked.
_DIAGNOSTICS = {
    "lost": Values(("F",), "bool"),
    "present": Values(("F",), "bool"),
    "restart": Values(("F",), "bool"),
    "confidence": Values(("F",), finite=False),
    "deviation": Values(("F", "D"), finite=False, low=0, high=np.inf),
    "covariance": Values(("F", "J", 3, 3), finite=False),
    "standing": Values(("F", 2), "bool"),
    "limb_margin": Values(("F", "L"), finite=False, low=0, high=np.inf),
    "limb_disagreement": Values(("F", "L"), finite=False, low=0),
    "limb_confidence": Values(("F", "L"), finite=False, low=0, high=1),
}


@dataclass(frozen=True, eq=False, repr=False)
class Track:
    """A tracked person, one row per frame F.

    body_name: the body model's. dof_names: (D,). joint_names: (J,). fps: of the sequence. frames:
    (F,) int, frame indices of the sequence. poses: (F, D) radians and metres. joints: (F, J, 3) m
    in the world, Z up. edges: (E, 2) int joint pairs to draw. A track of points without a body, see
    `apf.tracking.triangulated`, has no degrees of freedom, and NaN where a point is missing.
    diagnostics: arrays (F, ...) by name, see below.
    provenance: JSON text that says how the track was made: sequence (path), device, version, grid
    (origin m, voxel_size m, shape) if voxels were used, method, objective, filter and further
    settings; smoothing and interrupted, if they apply. body: the model that was tracked, in the
    person's size; None if an older file does not hold it. surface: the person's, if the take was
    tracked with a personal body. Raises InputError if shapes disagree.

    A `track.npz` has a key for each field by its name, the body as TOML, `cones` (F, C, 16) of that
    body in the world (see `psfs.common.cones`; NaN where the person or the limb is lost), and
    `diagnostic_<name>` for each of the diagnostics, `surface_<field>` for each of its fields. ess,
    beta, best_log_weight (F, n_layers): effective sample size, annealing exponent, and log weight
    of the best particle at exponent 1. deviation (F, D): standard deviation of the particles, rad
    or m. misfit (F,): see `apf.likelihood.base`. restart (F,): 0 tracked, 1 found near the last
    good pose, 2 found by a global search. limb_margin, limb_disagreement (F, L): the inputs of
    `limb_confidence`; the latter exists if several passes were compared. confidence, lost, present,
    covariance, standing, limb_confidence: see the properties.
    """

    body_name: str
    dof_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    fps: float
    frames: np.ndarray
    poses: np.ndarray
    joints: np.ndarray
    edges: np.ndarray
    diagnostics: Mapping[str, np.ndarray] = field(default_factory=dict)
    provenance: str = "{}"
    body: BodyModel | None = None
    surface: Surface | None = None

    def __post_init__(self) -> None:
        set_ = object.__setattr__  # the fields of a frozen dataclass are set this way
        set_(self, "dof_names", tuple(map(str, self.dof_names)))
        set_(self, "joint_names", tuple(map(str, self.joint_names)))
        set_(self, "fps", float(self.fps))
        set_(self, "frames", np.asarray(self.frames, np.int64))
        set_(self, "poses", np.asarray(self.poses, np.float64))
        set_(self, "joints", np.asarray(self.joints, np.float64))
        set_(self, "edges", np.asarray(self.edges, np.int64).reshape(-1, 2))
        set_(self, "diagnostics", {k: np.asarray(v) for k, v in self.diagnostics.items()})
        self._check()

    def _check(self) -> None:
        n, n_joints = len(self.frames), len(self.joint_names)
        expected = {"frames": (n,), "poses": (n, len(self.dof_names)), "joints": (n, n_joints, 3)}
        for name, shape in expected.items():
            actual = getattr(self, name).shape
            if actual != shape:
                raise InputError(f"{name} has shape {actual}; expected {shape}")
        for name, values in self.diagnostics.items():
            if values.shape[:1] != (n,):
                raise InputError(f"{name} has shape {values.shape}; expected {n} rows")
        limbs = [] if self.body is None else limb_ends(self.body)
        for name in ("limb_margin", "limb_disagreement", "limb_confidence"):
            rows = self.diagnostics.get(name)
            if rows is not None and rows.shape != (n, len(limbs)):
                raise InputError(
                    f"{name} has shape {rows.shape}; the body has {len(limbs)} limbs in {n} frames"
                )
        if self.edges.size and not 0 <= self.edges.min() <= self.edges.max() < n_joints:
            raise InputError(f"edges name joints outside 0..{n_joints - 1}")
        if self.body is not None and not (
            self.body.dof_names == self.dof_names
            and tuple(self.body.joint_names) == self.joint_names
        ):
            raise InputError(f"the body {self.body.name} is not the one that was tracked")
        check_number("fps", self.fps, 1e-12, 1e5)
        for name in ("poses", "joints") if self.dof_names else ("poses",):
            if not np.isfinite(getattr(self, name)).all():
                raise InputError(f"{name} hold a number that is not finite; expected finite ones")
        if np.any(np.diff(self.frames) <= 0):
            raise InputError("frames are not ascending; expected each once, in their order")
        _provenance(self.provenance)

    def __len__(self) -> int:
        return len(self.frames)

    def __repr__(self) -> str:
        counts = f"{len(self)} frames at {self.fps:g}/s, {int(self.lost.sum())} without the person"
        sure = self.confidence[~self.lost]
        words = f", confidence {np.median(sure):.2f}" if np.isfinite(sure).any() else ""
        return f"<Track of {self.body_name}: {counts}{words}>"

    def _repr_html_(self) -> str:
        """Return the motion as a notebook shows it."""
        moving = animate_skeleton(self.joints[~self.lost], self.edges, self.fps)
        return f"{moving}<div>{html.escape(repr(self))}</div>"

    def select(self, rows: np.ndarray) -> Track:
        """Return the track in some of its rows: (F,) bool, or their indices."""
        return replace(
            self,
            frames=self.frames[rows],
            poses=self.poses[rows],
            joints=self.joints[rows],
            diagnostics={name: values[rows] for name, values in self.diagnostics.items()},
        )

    @property
    def times(self) -> np.ndarray:
        """Time (F,), s, since the sequence's first frame."""
        return self.frames / self.fps

    @property
    def lost(self) -> np.ndarray:
        """Frames (F,) bool in which the tracker had no pose of the person, who is lost or not
        present; all False if not reported."""
        return self._diagnostic("lost", np.zeros(len(self), bool)).astype(bool)

    @property
    def present(self) -> np.ndarray:
        """Frames (F,) bool that show a person; all True if not reported."""
        return self._diagnostic("present", np.ones(len(self), bool)).astype(bool)

    @property
    def confidence(self) -> np.ndarray:
        """Confidence (F,) in [0, 1] of the tracker in each frame; NaN if not reported."""
        return self._diagnostic("confidence", np.full(len(self), np.nan))

    @property
    def restarts(self) -> np.ndarray:
        """Frame numbers (n,) in which the person was found again by a new search."""
        return self.frames[self._diagnostic("restart", np.zeros(len(self), int)) > 0]

    @property
    def covariance(self) -> np.ndarray:
        """Covariance (F, J, 3, 3), m^2, of each joint's position; NaN if not reported."""
        shape = (len(self), len(self.joint_names), 3, 3)
        return self._diagnostic("covariance", np.full(shape, np.nan))

    def _diagnostic(self, name: str, default: np.ndarray) -> np.ndarray:
        return self.diagnostics.get(name, default)

    @property
    def standing(self) -> np.ndarray:
        """Stances (F, 2) bool: whether the left and the right foot stand on the floor. Known for
        smoothed tracks only, else all False."""
        return self._diagnostic("standing", np.zeros((len(self), 2), bool)).astype(bool)

    @property
    def limb_confidence(self) -> np.ndarray:
        """Probability (F, L) that each of the body's limbs (`apf.body.limbs.limb_names`) is right,
        see `apf.tracking.limb_confidence`; NaN without a limb search."""
        stored = self.diagnostics.get("limb_confidence")
        if stored is None:
            ends = [] if self.body is None else limb_ends(self.body)
            margins = self._diagnostic("limb_margin", np.full((len(self), len(ends)), np.nan))
            other = self.diagnostics.get("limb_disagreement")
            stored = limb_confidence(margins, self.joints[:, ends], self.times, other)
        return stored

    @property
    def judged(self) -> Track:
        """The track with its `limb_confidence` stored, which then no longer follows the joints."""
        stated = {**self.diagnostics, "limb_confidence": self.limb_confidence}
        return replace(self, diagnostics=stated)

    @property
    def lost_limbs(self) -> np.ndarray:
        """Limbs (F, L) bool that are probably wrong while the person is tracked."""
        return (self.limb_confidence < LOST) & ~self.lost[:, None]

    @property
    def its_body(self) -> BodyModel:
        """The body that was tracked. Raises InputError if the track does not hold it."""
        if self.body is None:
            what = "body.toml beside track.npz, as `apf track` writes it"
            what = what if self.dof_names else "another one: triangulated points have none"
            raise InputError(
                f"the track of {self.body_name} does not hold its body; expected {what}"
            )
        return self.body

    @property
    def smoothing(self) -> dict[str, Any] | None:
        """The settings with which `apf smooth` made the track; None if it was not smoothed."""
        return _provenance(self.provenance).get("smoothing")

    @property
    def interrupted(self) -> bool:  # in the forward or in the backward pass
        return bool(_provenance(self.provenance).get("interrupted", False))

    @property
    def angles(self) -> dict[str, np.ndarray]:
        """Joint angles (F,), degrees, by clinical name (`l_knee_flexion`); see `apf.body.angles`.
        They are NaN where the person or the limb is lost. Ankle angles of a body whose feet do not
        bend are known only for smoothed tracks, in frames in which the foot stands flat. Raises
        InputError if the track does not hold its body."""
        angles = joint_angles(self.its_body, self.poses)
        if self.standing.any() and (ankles := find_ankles(self.its_body)):
            level = detect_flat_feet(self.joints[:, ankles], self.standing)
            angles |= standing_ankles(self.its_body, self.poses, level)
        gone = self.lost[:, None] | (self.lost_limbs @ limb_angles(self.its_body, angles))
        return {
            name: np.where(lost_bones, np.nan, values)
            for lost_bones, (name, values) in zip(gone.T, angles.items(), strict=True)
        }

    @property
    def points(self) -> JointSeries:
        """The points for point files: the joints and, if the track holds its body, the virtual
        markers on heels, toes and hands. They are NaN where the person or the limb is lost. A
        marker gets the largest uncertainty of the joints on its bone."""
        names, points = list(self.joint_names), self.joints
        gone = np.zeros((len(self), len(names)), bool)
        if self.body is not None:
            gone = self.lost_limbs @ limb_joints(self.body)
        away = np.sqrt(np.einsum("fjaa->fj", self.covariance))
        if self.body is not None and (markers := virtual_markers(self.body)):
            names += [marker.name for marker in markers]
            points = np.concatenate([points, posed_points(self.body, self.poses, markers)], 1)
            bones = np.array([joint.bone for joint in self.body.joints])
            beside = [away[:, bones == marker.bone].max(1) for marker in markers]
            away = np.column_stack([away, *beside])
            on_limbs = limb_bones(self.body)[:, [marker.bone for marker in markers]]
            gone = np.column_stack([gone, self.lost_limbs @ on_limbs])
        points = np.where((gone | self.lost[:, None])[..., None], np.nan, points)
        note = "smoothed" if self.smoothing is not None else "as tracked, not smoothed"
        note = f"psfs-apf, {self.body_name}, {note}"
        return JointSeries(tuple(names), points, self.fps, self.frames, away, note)

    @property
    def motion(self) -> BodyMotion:
        """The content of motion files with a body. Raises InputError if the track does not hold its
        body."""
        limbs = self.lost_limbs
        poses = interpolate_gaps(self.poses, self.times, limbs @ limb_masks(self.its_body))
        return BodyMotion(self.its_body, poses, self.lost, limbs, self.points)

    def save(self, path: str | Path, axes: str = "y-up") -> None:
        """Write the track as it is; the suffix of `path` selects the format.

        .npz: everything, for `open`: the fields by their names, diagnostics as diagnostic_<name>.
        .trc, .csv, .c3d: `points`; axes, for TRC: y-up, z-up or pose2sim. .bvh, .glb: the moving
        body. .mot: joint angles for OpenSim. See `apf.formats`. Raises InputError for any other
        suffix, if the file cannot be written, or if the track does not hold its body and the file
        needs it.
        """
        ending = Path(path).suffix.lower()
        if axes not in CONVENTIONS:
            raise InputError(f"axes are {axes!r}; expected one of {', '.join(CONVENTIONS)}")
        if ending == ".npz":
            self._write_npz(path)
        elif ending == ".trc":
            write_trc(path, self.points, axes)
        elif ending in WRITERS:
            WRITERS[ending](path, self.points)
        elif ending in BODY_WRITERS:
            BODY_WRITERS[ending](path, self.motion)
        else:
            raise InputError(
                f"{path}: a track is not written as {ending or 'a file without an ending'}; "
                f"expected {join_names(('.npz', *WRITERS, *BODY_WRITERS))}"
            )

    def _write_npz(self, path: str | Path) -> None:
        arrays: dict[str, Any] = {
            "body_name": self.body_name,
            "dof_names": np.array(self.dof_names, dtype=str),
            "joint_names": np.array(self.joint_names, dtype=str),
            "fps": self.fps,
            "frames": self.frames,
            "poses": self.poses,
            "joints": self.joints,
            "edges": self.edges,
            "provenance": self.provenance,
        }
        if self.body is not None:
            arrays["body"] = format_body(self.body)
            arrays["cones"] = self.known_cones.astype(np.float32)
        if self.surface is not None:
            arrays |= {name: getattr(self.surface, name[8:]) for name in _SURFACE}
        arrays |= {_DIAGNOSTIC + name: values for name, values in self.diagnostics.items()}
        with write_atomically(path) as temporary:
            np.savez_compressed(temporary, **arrays)

    @property
    def known_cones(self) -> np.ndarray:
        """The posed cones (F, C, 16), see `psfs.common.cones`, for `psfs`, which knows no bodies;
        NaN where the person or the limb is lost."""
        body = self.its_body
        cones = posed_cones(body, self.poses)
        lost = self.lost_limbs @ limb_bones(body)[:, [cone.bone for cone in body.cones]]
        cones[lost | self.lost[:, None]] = np.nan
        return cones

    @property
    def as_interrupted(self) -> Track:
        """The track, marked as one that an interrupt or an error ended early."""
        made = {**_provenance(self.provenance), "interrupted": True}
        return replace(self, provenance=json.dumps(made))

    @classmethod
    def open(cls, path: str | Path) -> Track:
        """Return the track of an npz that `save` wrote, or of the folder that holds `track.npz`.

        If the file does not hold its body, it is read from `body.toml` beside it, if that exists.
        Raises InputError if the file is missing or invalid, or the folder of several people.
        """
        path = Path(path)
        if (path / PEOPLE).exists():
            raise InputError(f"{path}: of several people; expected one, as {path / 'person1'}")
        parts = [] if (path / "track.npz").exists() else sorted(path.glob(PARTS))
        if parts:  # of a run that was killed
            return concatenate_tracks(parts)
        runs = [run for prefix in ("", "person*/") for run in path.glob(f"{prefix}seed*/track.npz")]
        if runs and not (path / "track.npz").exists():
            raise InputError(f"{path}: {len(runs)} runs; expected one, as {min(runs).parent}")
        path = path / "track.npz" if path.is_dir() else path
        optional = _FIELDS | {k: replace(values, needed=False) for k, values in _SURFACE.items()}
        schema = optional | {
            _DIAGNOSTIC + name: replace(values, needed=False)
            for name, values in _DIAGNOSTICS.items()
        }
        data: dict[str, Any] = read_npz(path, schema, "a track that `apf track` wrote")
        diagnostics = {
            name.removeprefix(_DIAGNOSTIC): values
            for name, values in data.items()
            if name.startswith(_DIAGNOSTIC)
        }
        fields = {key: data[key] for key in _FIELDS if key != "body"}
        fields |= {key: get_scalar(data[key]) for key in ("body_name", "provenance", "fps")}
        if all(name in data for name in _SURFACE):
            fields["surface"] = Surface(**{name[8:]: data[name] for name in _SURFACE})
        beside = path.with_name("body.toml")
        if "body" in data:
            fields["body"] = parse_body(get_scalar(data["body"]), path)
        elif beside.is_file():
            fields["body"] = load_body(beside)
        try:
            return cls(diagnostics=diagnostics, **fields)
        except (TypeError, ValueError) as error:
            raise InputError(f"{path}: {error}") from None


def part_name(folder: Path, track: Track) -> Path:
    """Return the path of a chunk of a track that is stored while the rest is tracked."""
    return folder / "parts" / f"track_{track.frames[0]:09d}.npz"


def concatenate_tracks(parts: Iterable[Track | Path]) -> Track:
    """Return one track of the frames of several, which follow each other, with the diagnostics that
    all have; the rest is that of the last. Files are read one after the other, so that all rows are
    in memory only once. Raises InputError for a file that is no track."""
    columns: dict[str, list[np.ndarray]] = {}
    piece: Track | None = None
    for each in parts:
        piece = each if isinstance(each, Track) else Track.open(each)
        rows = {"frames": piece.frames, "poses": piece.poses, "joints": piece.joints}
        for name, values in (*rows.items(), *piece.diagnostics.items()):
            columns.setdefault(name, []).append(values)
    if piece is None:
        raise InputError("there is no part of a track; expected at least one")
    n_parts = len(columns["frames"])
    common = [name for name, values in columns.items() if len(values) == n_parts]
    whole = {name: np.concatenate(columns.pop(name)) for name in common}
    fields: dict[str, Any] = {name: whole.pop(name) for name in ("frames", "poses", "joints")}
    return replace(piece, diagnostics=whole, **fields)


def _provenance(text: str) -> dict[str, Any]:
    try:
        values = json.loads(text)
    except (ValueError, RecursionError):
        values = None
    if not isinstance(values, dict) or not isinstance(values.get("smoothing") or {}, dict):
        raise InputError("provenance is no JSON table; expected what made the track")
    return values
