"""The runs: tracking a recording by some method, and the file of what came out."""

from __future__ import annotations

import csv
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from accuracy.recordings import Recording, Replay
from accuracy.settings import Setting
from apf.config import FilterConfig
from apf.evaluate import evaluate
from apf.pipeline import at_rate, track_of, track_voxels
from apf.track import Track
from apf.tracker import AnnealedParticleFilter
from cl import Device, UserError
from psfs.files import written_whole


@dataclass(frozen=True)
class Run:
    """What one seed of a setting gave, mm.

    mean, median, largest: over joints and frames; frame_std: deviation of the frames' means;
    constant, rest: see `Evaluation.constant_and_rest`; lost_limbs: by name; lost_joints: share of
    joint-frames; seconds: to track all frames, voxels given. joints: name -> [mean, constant,
    rest].
    """

    setting: Setting
    seed: int
    frames: int
    mean: float
    median: float
    largest: float
    frame_std: float
    constant: float
    rest: float
    lost_limbs: list[str]
    lost_joints: float
    seconds: float
    joints: dict[str, list[float]]

    @property
    def lost(self) -> bool:
        return bool(self.lost_limbs)


Method = Callable[[Device, Recording, Setting, int], Track]

#: What the objectives of the annealed particle filter change in its settings.
OBJECTIVES: dict[str, dict[str, Any]] = {
    "default": {},
    "song": {"surface_weight": 0.0, "overlap_weight": 0.0},
    "surface": {"edge_weight": 0.0, "silhouette_weight": 0.0},
}


def annealed(device: Device, recording: Recording, setting: Setting, seed: int) -> Track:
    """The annealed particle filter over voxels, from the first frame's true joints."""
    if setting.objective not in OBJECTIVES:
        raise UserError(f"objective {setting.objective}; expected one of {', '.join(OBJECTIVES)}")
    config = FilterConfig(
        n_particles=setting.particles,
        n_layers=setting.layers,
        seed=seed,
        **OBJECTIVES[setting.objective],
    )
    scaled = at_rate(config, recording.fps / setting.step)
    body, pose = recording.first_pose
    tracker = AnnealedParticleFilter(device, body, recording.rig, recording.grid, scaled)
    frames, estimates = track_voxels(tracker, pose, Replay(device, recording))
    return track_of(body, recording.fps, frames, estimates, {"filter": asdict(config)})


#: What can track, by name.
METHODS: dict[str, Method] = {"apf": annealed}


def run(device: Device, recording: Recording, setting: Setting, seed: int) -> Run:
    """Track the whole recording once. Raises UserError for unknown methods and objectives."""
    if setting.method not in METHODS:
        raise UserError(f"method {setting.method}; expected one of {', '.join(METHODS)}")
    assert recording.first_pose  # fitted now, outside of the time taken
    began = time.perf_counter()
    track = METHODS[setting.method](device, recording, setting, seed)
    seconds = time.perf_counter() - began
    if len(track) < len(recording.frames):
        raise KeyboardInterrupt  # trackers keep what they have when they are interrupted
    found = evaluate(track, recording.truth)
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
        seconds=seconds,
        joints={name: row.tolist() for name, row in zip(found.joint_names, rows, strict=True)},
    )


@dataclass
class Results:
    """The runs so far and the file that keeps them; `conditions` are what they depend on besides
    their settings."""

    path: Path
    conditions: dict[str, Any]
    runs: list[Run] = field(default_factory=list)

    @classmethod
    def resumed(cls, path: Path, conditions: dict[str, Any]) -> Results:
        """With what the file holds, if there is one. Raises UserError if it is no such file or
        was made under other conditions."""
        conditions = json.loads(json.dumps(conditions))
        if not path.exists():
            return cls(path, conditions)
        try:
            data = json.loads(path.read_text())
            kept = [Run(**{**row, "setting": Setting(**row["setting"])}) for row in data["runs"]]
            before = data["conditions"]
        except (ValueError, KeyError, TypeError) as error:
            raise UserError(f"{path}: not the results of accuracy.py ({error})") from None
        if before != conditions:
            names = [k for k in conditions if before.get(k) != conditions[k]]
            raise UserError(
                f"{path}: made under other conditions ({', '.join(names)}); "
                "expected another -o, or the same"
            )
        return cls(path, conditions, kept)

    def lacks(self, setting: Setting, seed: int) -> bool:
        return not any(run.setting == setting and run.seed == seed for run in self.runs)

    def of(self, setting: Setting) -> list[Run]:
        return [run for run in self.runs if run.setting == setting]

    def add(self, run: Run) -> None:
        """Keep a run, on disk too."""
        self.runs.append(run)
        data = {"conditions": self.conditions, "runs": [asdict(run) for run in self.runs]}
        with written_whole(self.path) as temporary:
            temporary.write_text(json.dumps(data, indent=1) + "\n")

    def write_csv(self, path: Path) -> None:
        """One row per run; errors in mm."""
        columns = [f.name for f in fields(Run) if f.name not in ("setting", "joints")]
        with written_whole(path) as temporary, temporary.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow([f.name for f in fields(Setting)] + columns)
            for run in self.runs:
                row = {**asdict(run), "lost_limbs": "; ".join(run.lost_limbs)}
                cells = [row[name] for name in columns]
                shown = [f"{cell:.4g}" if isinstance(cell, float) else cell for cell in cells]
                writer.writerow([*asdict(run.setting).values(), *shown])
