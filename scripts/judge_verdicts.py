#!/usr/bin/env python3
"""How often the verdict of a track is right: tracks of sound and spoilt takes against the truth.

    scripts/judge_verdicts.py track FOLDER -o OUT [--part 0/8] [--frames 40]

tracks every sequence with truth.npz in FOLDER, by voxels and by keypoints, forward only and both
ways, sound and spoilt (see `verdicts/spoiling.py`), and writes a folder for each track.

    scripts/judge_verdicts.py table scripts/results/verdicts.json

counts the verdicts of such tracks by their share of joints beyond 150 mm.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
import time
import traceback
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.table import Table
from verdicts.spoiling import (
    FOOTAGE,
    GIVEN_STARTS,
    KEYPOINTS,
    open_keypoints,
    spoil_footage,
    spoil_keypoints,
    spoil_start,
)

from apf.evaluation.evaluate import evaluate, load_truth
from apf.filters.method import Method
from apf.formats.trc import JointSeries
from apf.keypoints.agreement import find_disagreements
from apf.report.judged import judge_track
from apf.report.quality import Quality
from apf.tracking.settings import TakeSettings
from apf.tracking.take import track_take
from cl import Device, NumpyDevice, UserError, select_device
from psfs.cli.commandline import add_message_flags, stdout
from psfs.cli.program import run_command
from psfs.common.files import write_json
from psfs.diagnostics.examination import examine
from psfs.sequence import Sequence
from psfs.session import Session, SessionSettings

#: Shares of joints beyond 150 mm that part the columns of the table.
_SHARES = (0.0, 0.01, 0.1)
#: Where the frames begin, as a share of those to spare, by the seed.
_BEGIN = (0.5, 0.2, 0.8)
#: Particles and layers of the poor search.
_POOR = {"n_particles": 30, "n_layers": 3}


@dataclass(frozen=True)
class Job:
    """A track: of a sequence, by voxels or keypoints, spoilt in one way."""

    sequence: str
    by: str
    how: str
    seed: int = 0

    @property
    def name(self) -> str:
        return f"{self.sequence}.{self.by}.{self.how.replace(' ', '_')}.{self.seed}"


def plan(folder: Path, seed: int, chosen: list[str] | None = None) -> list[Job]:
    """Return the jobs in random order: all sequences with truth of one person, with each kind
    of fault or the chosen ones."""
    names = sorted(path.parent.name for path in folder.glob("*/truth.npz"))
    names = [name for name in names if not list(folder.glob(f"{name}/truth_person*.npz"))]
    ways = [*(("voxels", how) for how in FOOTAGE), *(("keypoints", how) for how in KEYPOINTS)]
    ways = [way for way in ways if chosen is None or way[1] in chosen]
    jobs = [Job(name, by, how, seed) for by, how in ways for name in names]
    random.Random(1 + seed).shuffle(jobs)  # so that a part of them is a fair sample
    return jobs


def track(folder: Path, job: Job, device: Device | NumpyDevice, n_frames: int, out: Path) -> None:
    """Track and judge a job, and write what the verdict is made of."""
    path = folder / job.sequence
    sequence, truth = Sequence.open(path), load_truth(path / "truth.npz")
    step = 4 if job.how == "slow" else 1
    spare = max(0, len(sequence) - 8 - step * n_frames)
    first = int(spare * _BEGIN[job.seed % len(_BEGIN)])
    frames = slice(first, min(first + step * n_frames, len(sequence) - 8), step)
    warnings: list[str] = []
    keypoints, given = None, {}
    poor = _POOR if job.how == "poor search" else {}
    if job.by == "voxels":
        method = Method.create(**poor)
        session = Session(
            spoil_footage(sequence, job.how, job.seed), device, SessionSettings(selection=frames)
        )
        found = examine(session)
        session, warnings = found.session, found.remaining
        given = {"given": spoil_start(truth, first, job.how)} if job.how in GIVEN_STARTS else {}
    else:
        method = Method.create(objective="keypoints", **poor)
        session = Session(sequence, device, SessionSettings(selection=frames))
        sound = open_keypoints(sequence, truth, job.seed)
        keypoints = spoil_keypoints(sound, sequence.rig, job.how, job.seed)
        warnings = find_disagreements(keypoints, sequence.rig, sequence.fps)
        given = {"keypoints": keypoints}
    if job.how in ("one way", "poor search"):
        method = method.replace(both_ways=False, runs=1)
    take = track_take(session, TakeSettings(method=method, seeds=(job.seed,), **given))
    doubts = [*warnings, *(take.start.doubts if take.start is not None else [])]
    quality = judge_track(session, take.tracks[0], keypoints=keypoints, doubts=doubts)
    _write(out / job.name, job, quality, truth)


def _write(out: Path, job: Job, quality: Quality, truth: JointSeries) -> None:
    found = evaluate(quality.track, truth)
    out.mkdir(parents=True, exist_ok=True)
    quality.track.save(out / "track.npz")
    arrays = {"errors": found.errors, "frames": found.frames}
    if quality.near is not None:
        arrays["near"] = quality.near
    if quality.agreement is not None:
        agreed = vars(quality.agreement)
        names = ("rows", "body_iou", "voxel_iou", "inside", "explained")
        arrays |= {name: agreed[name] for name in names}
    np.savez_compressed(out / "raw.npz", **arrays)
    facts = {
        **asdict(job),
        "verdict": quality.verdict,
        "says": quality.lines(),
        "mean_error": found.mean_error,
        "lost_share": found.lost_share,
    }
    write_json(out / "facts.json", facts)


def main() -> int:
    parser = argparse.ArgumentParser(prog="judge_verdicts.py", description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("track", "table"))
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("-o", "--out", type=Path, default=Path("verdicts"), metavar="OUT")
    parser.add_argument("--part", default="0/1", metavar="K/N", help="every Nth job, from the Kth")
    parser.add_argument("--seed", type=int, default=0, help="of spoiling, search and frames")
    parser.add_argument("--ways", nargs="+", metavar="WAY", help="see FOOTAGE and KEYPOINTS")
    parser.add_argument("--backward", action="store_true", help="the last jobs first")
    parser.add_argument("--frames", type=int, default=40, metavar="N")
    parser.add_argument(
        "--seconds", type=float, default=1e9, metavar="S", help="begin no job after"
    )
    parser.add_argument("--device", default="auto")
    add_message_flags(parser)
    parser.set_defaults(run=_run)
    return run_command(parser)


def print_table(path: Path) -> None:
    """Print how many tracks of each verdict have which share of joints beyond 150 mm."""
    for part, runs in json.loads(path.read_text()).items():
        table = Table("by", "verdict", "none", "to 1 %", "to 10 %", "more", title=part)
        known = [run for run in runs if "verdict" in run]
        for by in ("voxels", "keypoints"):
            for verdict in ("good", "doubtful", "bad", "unknown"):
                of = [r["lost_share"] for r in known if (r["by"], r["verdict"]) == (by, verdict)]
                counts = np.bincount(np.searchsorted(_SHARES, of), minlength=len(_SHARES) + 1)
                table.add_row(by, verdict, *map(str, counts))
        stdout.print(table)


def _run(args: argparse.Namespace) -> None:
    if args.what == "table":
        print_table(args.folder)
        return
    began = time.monotonic()
    part, n_parts = map(int, args.part.split("/"))
    device = select_device(args.device)
    jobs = plan(args.folder, args.seed, args.ways)[part::n_parts]
    for job in reversed(jobs) if args.backward else jobs:
        if time.monotonic() - began > args.seconds:
            break
        if (args.out / job.name / "facts.json").exists():
            continue
        clock = time.monotonic()
        try:
            track(args.folder, job, device, args.frames, args.out)
        except UserError as error:
            (args.out / job.name).mkdir(parents=True, exist_ok=True)
            write_json(args.out / job.name / "facts.json", {**asdict(job), "error": str(error)})
        except Exception:
            traceback.print_exc()
        print(job.name, round(time.monotonic() - clock, 1), flush=True)


if __name__ == "__main__":
    sys.exit(main())
