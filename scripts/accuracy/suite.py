"""A suite: every sequence with truth in a folder, tracked from nothing but its pictures, or its
keypoints, and from the true first joints; and its keypoints triangulated."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Iterator
from collections.abc import Sequence as Items
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomllib
from peers.figures import LIMB_JOINTS, measure_track

from accuracy.ablation import load_preset
from accuracy.runs import Results, Run, Setting, evaluate_run, make_method
from apf.body.model import BodyModel
from apf.body.stature import stature
from apf.body.toml import load_body
from apf.evaluation.angle_truth import evaluate_angles
from apf.evaluation.evaluate import LIMB_ENDS, LOST_JOINT, LOST_LIMB, Evaluation, evaluate
from apf.evaluation.joint_names import EVALUATED_JOINTS, evaluated_joints
from apf.evaluation.truth import load_truth
from apf.formats.trc import JointSeries
from apf.initialisation.sequence import initialise
from apf.initialisation.start import StartError
from apf.keypoints.keypoints import Keypoints
from apf.presets import Preset
from apf.request import TrackRequest
from apf.takes.start import read_given_start
from apf.tracking.settings import DEFAULT_BODY, TakeSettings
from apf.tracking.take import Take, track_take
from apf.tracking.track import Track
from apf.tracking.triangulated import TriangulatedConfig, triangulate_track
from cl import Device, InputError
from psfs.common.files import write_json
from psfs.diagnostics.examination import examine
from psfs.diagnostics.mask_scores import (
    CloudScore,
    mean_scores,
    score_cloud,
    score_silhouettes,
    truth_frames,
)
from psfs.diagnostics.sequence_info import find_keypoints
from psfs.sequence import Sequence
from psfs.session import Session, SessionSettings
from psfs.volume import automatic_grid

TRUTH = "truth.npz"
#: Where body and first pose come from: an automatic start, the true first joints, or these with
#: the girths of an automatic start by the defaults.
STARTS = ("found", "true", "measured")
#: Cut-off frequency of the triangulation, Hz: the usual one.
LOW_PASS = 6.0
#: The observations that need silhouettes.
_VOXELS = ("voxels", "both")
#: Joints that keypoints have, too.
_LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")


@dataclass(frozen=True)
class Job:
    """The work of one process at a time: the runs of `setting` with these seeds, or, without a
    setting, the silhouettes of a preset. `folder`: the sequence's."""

    folder: Path
    setting: Setting | None = None
    seeds: tuple[int, ...] = ()
    preset: str = ""

    @property
    def settings(self) -> Preset:
        """The settings of the preset, or the defaults."""
        name = self.setting.preset if self.setting is not None else self.preset
        return load_preset(name) if name else Preset()

    @property
    def silhouettes(self) -> str:
        """The name under which the silhouettes are stored."""
        return silhouettes_name(self.folder.name, self.preset)


def silhouettes_name(sequence: str, preset: str) -> str:
    """Return the name under which the silhouettes of a sequence by a preset are stored: that of the
    sequence alone if the preset does not change them."""
    default, settings = Preset(), load_preset(preset) if preset else Preset()
    own = (settings.reconstruction, settings.all_cameras)
    return (
        sequence if own == (default.reconstruction, default.all_cameras) else f"{sequence}.{preset}"
    )


#: The result of a job: its runs, or its silhouettes as `evaluate_silhouettes` returns them.
Outcome = list[Run] | dict[str, Any]


def suite_folders(folder: Path) -> list[Path]:
    """Return the folders of sequences with truth in `folder`, or `folder` itself. Raises InputError
    if there are none."""
    inside = sorted(path.parent.resolve() for path in folder.glob(f"*/{TRUTH}"))
    found = inside or [path.parent.resolve() for path in folder.glob(TRUTH)]
    if not found:
        raise InputError(f"{folder}: no sequence with {TRUTH} in it; expected at least one")
    return found


def lacking_jobs(
    settings: dict[Setting, Path], results: Results, seeds: int, kept: Callable[[str], bool]
) -> list[Job]:
    """Return the remaining jobs, the first seeds of all sequences first. kept: whether a sequence's
    silhouettes are known.

    Seeds that start from the true joints share one reconstruction; an automatic start is computed
    for each seed.
    """
    seen = [(f, s.preset) for s, f in settings.items() if s.observations in _VOXELS]
    pictures = {j.silhouettes: j for j in (Job(f, preset=name) for f, name in reversed(seen))}
    jobs = [j for j in pictures.values() if (j.folder / "truth_masks").is_dir()]
    jobs = [j for j in jobs if not kept(j.silhouettes)]
    for setting, folder in settings.items():
        count = 1 if setting.start == "none" else seeds  # triangulation is deterministic
        rest = [seed for seed in range(count) if results.lacks(setting, seed)]
        parts = [(seed,) for seed in rest] if setting.start == "found" else [tuple(rest)]
        jobs += [Job(folder, setting, part) for part in parts if part]
    return sorted(jobs, key=lambda job: job.seeds[:1])


def done(device: Device, job: Job, check: Callable[[], object]) -> Outcome:
    """Do a job. `check` is called now and then and may raise KeyboardInterrupt. Raises UserError if
    the sequence cannot be tracked; a failed automatic start is not an error, but a run."""
    settings = job.settings
    sequence = open_for_preset(job.folder, settings)
    reconstruction = settings.reconstruction
    if job.setting is not None:  # of a track
        reconstruction = reconstruction.reaching(TrackRequest.REACH)
    session = Session(sequence, device, SessionSettings(reconstruction))
    if job.setting is None:
        session = examine(session, settings.all_cameras).session
        return evaluate_silhouettes(session, check)
    truth = load_truth(job.folder / TRUTH)
    if job.setting.observations == "triangulation":
        return [_triangulate(sequence, job.setting, truth)]
    if job.setting.observations in _VOXELS:
        session = examine(session, settings.all_cameras).session
    began = time.perf_counter()
    try:
        take = _take(session, settings, job.setting, job.seeds, check)
    except StartError as error:
        return [Run(job.setting, seed, failed=str(error)) for seed in job.seeds]
    seconds = (time.perf_counter() - began) / len(job.seeds)
    if len(take.tracks[0]) < len(sequence):
        raise KeyboardInterrupt  # a tracker returns the frames so far when it is interrupted
    runs = []
    for seed, track in zip(job.seeds, take.tracks, strict=True):
        run = evaluate_run(track, truth, job.setting, seed, seconds)
        found = evaluate(track, truth)
        body = stature(take.body) / true_stature(job.folder, truth)
        figures = {"heading": heading_error(track, truth), "stature": 100 * (body - 1)}
        own: dict[str, Any] = {
            "angles": _angles(track, job.folder / TRUTH),
            "exported": _export(track, truth),
        }
        if job.setting.start == "true":
            own["by_frame"] = [round(1000 * float(error), 1) for error in found.frame_errors]
        runs.append(replace(run, **figures, **_list_suite_figures(found), **own))
    return runs


def _angles(track: Track, truth: Path) -> dict[str, list[float]]:
    """Return the errors of the joint angles, see `Run.angles`."""
    return {error.name: [error.rms, error.free] for error in evaluate_angles(track, truth)}


def _export(track: Track, truth: JointSeries) -> dict[str, float]:
    """Return the figures of the exported joints, see `Run.exported`; {} if one is missing."""
    names = track.joint_names if track.body is None else track.points.joint_names
    if not set(LIMB_JOINTS) <= set(truth.joint_names) & set(names):
        return {}
    figures = asdict(measure_track(track, truth))
    return {name: value for name, value in figures.items() if name != "joints"}


def _triangulate(sequence: Sequence, setting: Setting, truth: JointSeries) -> Run:
    """Triangulate keypoints and filter them with a low pass, the usual way without a body."""
    began = time.perf_counter()
    keypoints = Keypoints.open(sequence.folder, sequence)
    track = triangulate_track(sequence, keypoints, TriangulatedConfig(low_pass=LOW_PASS))
    run = evaluate_run(track, truth, setting, 0, time.perf_counter() - began)
    figures = {"heading": heading_error(track, truth)}
    figures |= _list_suite_figures(evaluate(track, truth))
    return replace(run, **figures, exported=_export(track, truth))


def _take(
    session: Session,
    settings: Preset,
    setting: Setting,
    seeds: Items[int],
    check: Callable[[], object],
) -> Take:
    """Track as `apf track FOLDER` does, or as with `--init FOLDER/truth.npz`; with `--keypoints` if
    the setting uses them."""
    sequence = session.sequence
    init = sequence.folder / TRUTH if setting.start in ("true", "measured") else None
    body = settings.body or DEFAULT_BODY
    template: BodyModel | str = body
    if setting.start == "measured":
        template = measure_body(session.device, sequence.folder, body, check)
    given = read_given_start(sequence.folder, 0, template if init else settings.body, init)
    keypoints = None
    if setting.observations != "voxels":
        keypoints = Keypoints.open(sequence.folder, sequence)
    if setting.observations == "keypoints":
        setting = replace(setting, objective="keypoints")
    take_settings = TakeSettings(
        method=make_method(setting, seeds[0]), seeds=tuple(seeds), template=load_body(body),
        given=given, keypoints=keypoints,
    )  # fmt: skip
    return track_take(session, take_settings, progress=lambda stage: check())


def measure_body(device: Device, folder: Path, body: str, check: Callable[[], object]) -> BodyModel:
    """Return the body of this name with the lengths and girths that the defaults' automatic start
    finds in the sequence's voxels."""
    session = examine(Session(Sequence.open(folder), device)).session
    automatic_grid(session)
    return initialise(session, load_body(body), progress=check).body


def _list_suite_figures(found: Evaluation) -> dict[str, float]:
    """Return the figures of the joints that only the runs of a suite have."""
    names = found.joint_names
    ends = [names.index(end) for end in LIMB_ENDS.values() if end in names]
    wrists = [k for k, name in enumerate(names) if name.endswith("wrist")]
    limbs = [k for k, name in enumerate(names) if name[2:] in _LIMBS]
    errors, known = found.errors[:, limbs], np.isfinite(found.errors[:, limbs])
    return {
        "wrists": 1000 * float(np.nanmean(found.errors[:, wrists])) if wrists else np.nan,
        "limb_frames": float((found.errors[:, ends] > LOST_LIMB).any(axis=1).mean()),
        "limbs": 1000 * float(np.nanmean(errors)),
        "limbs_rest": 1000 * float(np.nanmean(found.constant_and_rest[1][limbs])),
        "limbs_far": float((errors[known] > LOST_JOINT).mean()),
    }


def heading_error(track: Track, truth: JointSeries) -> float:
    """Return the angle, degrees, between the hips' left-right axes, seen from above, of the track
    and of the truth in the first tracked frame; NaN if the truth lacks them."""
    rows = np.flatnonzero(truth.frames == track.frames[0])
    if not rows.size:
        return float("nan")
    axes = []
    for names, joints in (
        (track.joint_names, track.joints[:1]),
        (truth.joint_names, truth.joints[rows[:1]]),
    ):
        evaluated, _, _ = evaluated_joints(names, joints)
        left, right = (evaluated[0, EVALUATED_JOINTS.index(f"{side}_hip"), :2] for side in "lr")
        axes.append(left - right)
    (a, b), (c, d) = axes
    return float(abs(np.degrees(np.arctan2(a * d - b * c, a * c + b * d))))


def true_stature(folder: Path, truth: JointSeries) -> float:
    """Return the person's stature, m: from synthetic.toml or README.md ("height 1.74 m"), else that
    of a body fitted to the first true joints, which may be off by 2 %."""
    made = folder / "synthetic.toml"
    if made.is_file():
        return float(tomllib.loads(made.read_text())["synthetic"]["height"])
    readme = folder / "README.md"
    stated = re.search(r"height (\d\.\d+) m\b", readme.read_text() if readme.is_file() else "")
    if stated:
        return float(stated[1])
    fitted = read_given_start(folder, int(truth.frames[0]), DEFAULT_BODY, folder / TRUTH)
    assert fitted is not None
    return stature(fitted[0])


def evaluate_silhouettes(session: Session, check: Callable[[], object]) -> dict[str, Any]:
    """Return the IoU with the true masks: the mean, and per frame those of the cameras; see
    psfs.diagnostics.mask_scores. Then the means over frames of the clouds' scores; see
    psfs.diagnostics.mask_scores."""
    wanted = truth_frames(session.sequence)
    frames: dict[str, list[float | None]] = {}
    clouds: list[CloudScore] = []
    shown_ones = score_silhouettes(session, wanted) if wanted else ()
    for shown in shown_ones:
        check()
        if shown is not None:
            scores = shown.scores[:, 0]
            frames[str(shown.frame.index)] = [None if np.isnan(s) else float(s) for s in scores]
            clouds.append(score_cloud(session.rig, shown.cloud, shown.truth))
    known = [score for scores in frames.values() for score in scores if score is not None]
    means = mean_scores(clouds)
    return {"mean_iou": float(np.mean(known)) if known else None, "frames": frames, "cloud": means}


@dataclass
class KeptSilhouettes:
    """The silhouettes' IoU by sequence, in a folder. `conditions`: of their computation; entries
    made under other conditions are ignored."""

    folder: Path
    conditions: dict[str, Any]

    def select(self, sequence: str) -> dict[str, Any] | None:
        try:
            found: dict[str, Any] = json.loads((self.folder / f"{sequence}.json").read_text())
        except (OSError, ValueError):
            return None
        return found if found.get("conditions") == self.conditions else None

    def add(self, sequence: str, found: dict[str, Any]) -> None:
        write_json(self.folder / f"{sequence}.json", {"conditions": self.conditions, **found})

    def iou(self, sequence: str) -> float:
        """Return the mean over cameras and frames; NaN if it is unknown."""
        found = (self.select(sequence) or {}).get("mean_iou")
        return float("nan") if found is None else float(found)


def preset_settings(name: str) -> dict[str, Any]:
    """Return the settings that distinguish a preset's runs from others. Raises InputError for an
    unknown one."""
    method = load_preset(name).method
    search = method.filter.search
    size = {"particles": search.n_particles, "layers": search.n_layers}
    return {"method": method.search, "objective": method.objective, "preset": name, **size}


def suite_settings(
    folders: Items[Path],
    starts: Items[str],
    kinds: Items[str],
    first: dict[str, Any],
    presets: Items[str] = ("",),
) -> Iterator[tuple[Setting, Path]]:
    """Return a setting per sequence, observation and start.

    first: all but its sequence, cameras and step. The defaults are "" of `presets`; each other
    preset adds a setting with voxels. Settings with keypoints are left out for a sequence without
    them. Raises InputError if none is left.
    """
    left = False
    for folder in folders:
        sequence = Sequence.open(folder)
        lacking = find_keypoints(sequence.folder) is None
        for kind in kinds:
            if lacking and kind != "voxels":
                continue
            for start in ("none",) if kind == "triangulation" else starts:
                left = True
                setting = Setting(folder.name, len(sequence.rig), 1, **first, start=start)
                for name in presets:
                    if not name:
                        yield replace(setting, observations=kind), folder
                    elif kind == "voxels":
                        yield replace(setting, observations=kind, **preset_settings(name)), folder
    if not left:
        raise InputError(f"no sequence has keypoints; expected some, for {', '.join(kinds)}")


def open_for_preset(folder: Path, settings: Preset) -> Sequence:
    """Return the sequence with the background of a preset, if it has images to estimate that
    from."""
    sequence = Sequence.open(folder)
    if settings.background is None or not sequence.has_images:
        return sequence
    return Sequence.open(folder, background=settings.background)
