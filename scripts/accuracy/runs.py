"""The runs of a suite: what they vary, their figures, and the file that stores them."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from accuracy.ablation import load_preset
from apf.evaluation.evaluate import evaluate
from apf.filters.method import Method
from apf.filters.searches import OBJECTIVES
from apf.filters.term_weights import parse_weights
from apf.formats.trc import JointSeries
from apf.tracking.track import Track
from cl import InputError
from psfs.common.files import write_atomically, write_text

#: The observations of a suite's runs: keypoints triangulated, without a body; the voxels; the
#: keypoints instead of voxels; voxels and keypoints.
OBSERVATIONS = ("triangulation", "voxels", "keypoints", "both")


@dataclass(frozen=True)
class Setting:
    """All that distinguishes runs but their seed. step: every `step`-th frame is used. start: the
    first pose, "true" from the true joints, "found" from the images alone, "none" for
    triangulation, which has no pose. observations: one of `OBSERVATIONS`. preset: a
    paper's settings or one of `ABLATIONS`, the base that the other fields change; "" for the
    defaults."""

    sequence: str
    cameras: int
    step: int
    method: str
    objective: str
    particles: int
    layers: int
    start: str = "true"
    observations: str = "voxels"
    preset: str = ""


@dataclass(frozen=True)
class Run:
    """The result of one seed of a setting, mm.

    mean, median, largest: over joints and frames; frame_std: deviation of the frames' means;
    constant, rest: see `Evaluation.constant_and_rest`; lost_limbs: by name; lost_joints: share of
    joint-frames; lost_frames: number of frames that the tracker reported as lost; inside_95: share
    of joint-frames whose truth lies in the 95 % ellipsoid, -1 without covariance; seconds: to track
    all frames from given voxels; of seeds tracked at once, the share of one. joints: name -> [mean,
    constant, rest].

    The other fields are computed in runs of a suite, and NaN in others. wrists: mean of both.
    heading: degrees between the hips' axis in the first frame and the truth's, from above. stature:
    % by which the body is too tall. limb_frames: share of frames in which a limb's end is farther
    than `LOST_LIMB` from the truth. angles: name -> [RMS, RMS without the mean offset], degrees,
    where the truth has rotations. limbs, limbs_rest, limbs_far: as mean, rest and lost_joints, of
    the twelve joints that keypoints have as well, shoulders to ankles. flags: see `FlagCounts`;
    inside_unflagged: as inside_95, of limbs that are not reported as lost. exported: of these
    joints as `apf export` writes them, see `peers.figures.Figures`. by_frame: the mean over joints
    of each frame, of runs from the true first joints. seconds of such a run
    include start and reconstruction. failed: the error if there is no track; all figures are NaN
    then.
    """

    setting: Setting
    seed: int
    frames: int = 0
    mean: float = math.nan
    median: float = math.nan
    largest: float = math.nan
    frame_std: float = math.nan
    constant: float = math.nan
    rest: float = math.nan
    lost_limbs: list[str] = field(default_factory=list)
    lost_joints: float = math.nan
    lost_frames: int = 0
    inside_95: float = math.nan
    seconds: float = math.nan
    joints: dict[str, list[float]] = field(default_factory=dict)
    wrists: float = math.nan
    heading: float = math.nan
    stature: float = math.nan
    limb_frames: float = math.nan
    limbs: float = math.nan
    limbs_rest: float = math.nan
    limbs_far: float = math.nan
    flags: list[int] = field(default_factory=lambda: [0] * 4)
    inside_unflagged: float = math.nan
    exported: dict[str, float] = field(default_factory=dict)
    by_frame: list[float] = field(default_factory=list)
    angles: dict[str, list[float]] = field(default_factory=dict)
    failed: str = ""

    @property
    def lost(self) -> bool:
        return bool(self.lost_limbs)


def make_method(setting: Setting, seed: int) -> Method:
    """Return the search and the objective of a setting.

    An objective is one of `OBJECTIVES`, or sp@130 for a shape of 130 vertices per part (Rymut 2016,
    table 6.5), or terms of the voxels' likelihood joined by +, such as edge+silhouette. Raises
    InputError.
    """
    objective, _, vertices = setting.objective.partition("@")
    if setting.preset:
        settings = load_preset(setting.preset, search=setting.method, objective=objective)
        return _set_vertices(_set_size(settings.method, setting, seed), vertices)
    weights: dict[str, Any] = {}
    if objective not in OBJECTIVES:
        objective, weights = "voxel", parse_weights(objective.replace("+", ","))
    return _set_vertices(
        _set_size(Method.create(setting.method, objective, **weights), setting, seed), vertices
    )


def _set_size(method: Method, setting: Setting, seed: int) -> Method:
    """Return the method with the particles, layers and seed of a setting."""
    size = {"n_particles": setting.particles, "n_layers": setting.layers, "seed": seed}
    if setting.method == "sir":  # it has no layers: use as many evaluations in one
        size |= {"n_particles": setting.particles * setting.layers, "n_layers": 1}
    return method.replace(filter=method.filter.with_changes(**size))


def _set_vertices(method: Method, vertices: str) -> Method:
    """Return the method with this number of vertices per part, if it is given."""
    if not vertices:
        return method
    if not vertices.isdigit():
        raise InputError(f"{vertices!r} after @ of an objective; expected a number of vertices")
    return method.replace(image=method.image.replace(vertices_per_part=int(vertices)))


def evaluate_run(
    track: Track, truth: JointSeries, setting: Setting, seed: int, seconds: float
) -> Run:
    """Return the errors of a track against the truth."""
    found = evaluate(track, truth)
    constant, rest = found.constant_and_rest
    rows = 1000 * np.stack([np.nanmean(found.errors, axis=0), constant, rest], -1)
    return Run(
        setting=setting,
        seed=seed,
        frames=len(track),
        mean=1000 * found.mean_error,
        median=1000 * float(np.nanmedian(found.errors)),
        largest=1000 * float(np.nanmax(found.errors)),
        frame_std=1000 * float(found.frame_errors.std()),
        constant=1000 * float(constant.mean()),
        rest=1000 * float(rest.mean()),
        lost_limbs=[limb for limb, lost in found.lost_limbs.items() if lost],
        lost_joints=found.lost_share,
        lost_frames=int(found.lost.sum()),
        inside_95=found.summary()["inside_95"] or -1.0,
        flags=list(found.flags) if track.body is not None else [0] * 4,
        inside_unflagged=found.inside_unflagged,
        seconds=seconds,
        joints={name: row.tolist() for name, row in zip(found.joint_names, rows, strict=True)},
    )


#: Fields of `Setting` whose key in files is another.
_KEYS = {"observations": "witness"}


def _stored_setting(setting: Setting) -> dict[str, Any]:
    """Return the setting by the keys that files have."""
    return {_KEYS.get(name, name): value for name, value in asdict(setting).items()}


def _read_setting(row: dict[str, Any]) -> Setting:
    """Return the inverse of `_stored_setting`."""
    names = {key: name for name, key in _KEYS.items()}
    return Setting(**{names.get(key, key): value for key, value in row.items()})


def none_for_nan(value: Any) -> Any:
    """Return plain values with None for NaN, which JSON lacks."""
    return _change(value, lambda of: None if isinstance(of, float) and math.isnan(of) else of)


def nan_for_none(value: Any) -> Any:
    """Return the inverse of `none_for_nan`."""
    return _change(value, lambda of: math.nan if of is None else of)


def _change(value: Any, change: Callable[[Any], Any]) -> Any:
    """Return plain values with `change` made to each single one in them."""
    if isinstance(value, dict):
        return {name: _change(of, change) for name, of in value.items()}
    if isinstance(value, list):
        return [_change(of, change) for of in value]
    return change(value)


def _plain(run: Run) -> dict[str, Any]:
    """Return the run as JSON values: None for NaN."""
    return none_for_nan({**asdict(run), "setting": _stored_setting(run.setting)})


def _parse_row(row: dict[str, Any]) -> Run:
    """Return the inverse of `_plain`."""
    return Run(**{**nan_for_none(row), "setting": _read_setting(row["setting"])})


@dataclass
class Results:
    """The runs so far and the file that stores them. conditions: of all runs, besides their
    settings. made: the day of the last one."""

    path: Path
    conditions: dict[str, Any]
    runs: list[Run] = field(default_factory=list)
    made: str = ""

    @classmethod
    def read(cls, path: Path) -> Results:
        """Read results from a file. Raises InputError if it does not hold results."""
        try:
            data = json.loads(path.read_text())
            runs = [_parse_row(row) for row in data["runs"]]
            return cls(path, dict(data["conditions"]), runs, data["made"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path}: not the results of accuracy.py ({error})") from None

    @classmethod
    def resume(cls, path: Path, conditions: dict[str, Any]) -> Results:
        """Return new results, with those of the file if it exists. Raises InputError if it does not
        hold results, or holds some made under other conditions."""
        conditions = json.loads(json.dumps(conditions))
        if not path.exists():
            return cls(path, conditions)
        found = cls.read(path)
        before = found.conditions
        # Folders may be added; those that are known must be the same.
        known, given = (of.pop("folders", {}) for of in (before, conditions))
        names = [key for key in conditions if before.get(key) != conditions[key]]
        names += [name for name in given if known.get(name, given[name]) != given[name]]
        if names:
            raise InputError(
                f"{path}: made under other conditions ({', '.join(names)}); "
                "expected another -o, or the same"
            )
        conditions["folders"] = {**known, **given}
        return replace(found, conditions=conditions)

    def lacks(self, setting: Setting, seed: int) -> bool:
        return not any(run.setting == setting and run.seed == seed for run in self.runs)

    def select(self, setting: Setting) -> list[Run]:
        return [run for run in self.runs if run.setting == setting]

    def add(self, run: Run) -> None:
        """Add a run, and write it to disk."""
        self.runs.append(run)
        self.made = date.today().isoformat()
        runs = [_plain(run) for run in self.runs]
        data = {"conditions": self.conditions, "made": self.made, "runs": runs}
        write_text(self.path, json.dumps(data, allow_nan=False) + "\n")

    def write_csv(self, path: Path) -> None:
        """Write one row per run; errors in mm."""
        left_out = ("setting", "joints", "angles", "exported", "by_frame")
        columns = [f.name for f in fields(Run) if f.name not in left_out]
        with write_atomically(path) as temporary, temporary.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow([_KEYS.get(f.name, f.name) for f in fields(Setting)] + columns)
            for run in self.runs:
                row = {**asdict(run), "lost_limbs": "; ".join(run.lost_limbs)}
                row["flags"] = "; ".join(map(str, run.flags))
                cells = [row[name] for name in columns]
                shown = [f"{cell:.4g}" if isinstance(cell, float) else cell for cell in cells]
                writer.writerow([*asdict(run.setting).values(), *shown])
