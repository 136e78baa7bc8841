"""Runs of the programs, their file, and tables of them."""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Collection
from dataclasses import asdict, dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from accuracy.runs import Results, Run, nan_for_none, none_for_nan
from timings.grid import NONE, Grid, cell

from cl import InputError
from peers.figures import Figures
from peers.programs import PROGRAMS
from psfs.common.files import write_atomically, write_text

_COLUMNS = ("mean", "rest", "far", "gaps", "jitter", "skating")
_HEADS = (
    "mean, mm",
    "offset-free, mm",
    "beyond 150 mm",
    "gaps",
    "jitter, mm/frame²",
    "skating, mm",
)
_NOTE = "Means over the sequences of 12 joints."


@dataclass(frozen=True)
class PeerRun:
    """One program on one sequence. cpu, clock: seconds; cpu None on a GPU. failed: the error."""

    sequence: str
    program: str
    seed: int
    device: str
    commit: str
    figures: Figures | None = None
    cpu: float | None = None
    clock: float | None = None
    failed: str = ""


@dataclass
class PeerResults:
    """All runs so far, and the file that stores them. versions: of the peers' packages."""

    path: Path
    runs: list[PeerRun] = field(default_factory=list)
    versions: dict[str, dict[str, str]] = field(default_factory=dict)
    made: str = ""

    @classmethod
    def read(cls, path: Path) -> PeerResults:
        """Return the results in a file, none if there is no file. Raises InputError for others."""
        if not path.exists():
            return cls(path)
        try:
            data = json.loads(path.read_text())
            runs = [_parse_row(row) for row in data["runs"]]
            return cls(path, runs, data["versions"], data["made"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{path}: not the results of compare_peers.py ({error})") from None

    def has(self, sequence: str, program: str, seed: int) -> bool:
        key = (sequence, program, seed)
        return any((run.sequence, run.program, run.seed) == key for run in self.runs)

    def add(self, *runs: PeerRun) -> None:
        """Add runs and write the file."""
        self.runs += runs
        self.made = date.today().isoformat()
        data = {
            "made": self.made,
            "versions": self.versions,
            "runs": [asdict(run) for run in self.runs],
        }
        write_text(self.path, json.dumps(none_for_nan(data), indent=1, allow_nan=False) + "\n")

    def select(self, program: str) -> list[PeerRun]:
        return [run for run in self.runs if run.program == program]


#: Our programs by the observations of a suite's runs.
_OURS = {"voxels": "ours: voxels", "keypoints": "ours: keypoints", "both": "ours: both"}


def replace_suite_runs(results: PeerResults, path: Path, programs: Collection[str]) -> None:
    """Replace our runs of `programs` by those with an automatic start in the results of
    `accuracy.py --suite --by`, where these have some, on the sequences that the peers were run on.
    Raises InputError."""
    suite = Results.read(path)
    known = {run.sequence for run in results.runs}
    ours = [
        PeerRun(
            *(run.setting.sequence, _OURS[run.setting.observations], run.seed),
            *(suite.conditions["device"], suite.conditions["commit"]),
            figures=_read_figures(run), clock=run.seconds,
        )
        for run in suite.runs
        if _OURS.get(run.setting.observations) in programs and run.setting.sequence in known
        and run.setting.start == "found" and not run.setting.preset and not run.failed
    ]  # fmt: skip
    replaced = {(run.sequence, run.program) for run in ours}
    results.runs = [run for run in results.runs if (run.sequence, run.program) not in replaced]
    results.add(*ours)


def _read_figures(run: Run) -> Figures:
    """Return the figures of the exported joints; of older files those that they have."""
    if run.exported:
        return Figures(**run.exported, joints={})
    nothing = dict.fromkeys(("gaps", "jitter", "skating"), np.nan)
    return Figures(mean=run.limbs, rest=run.limbs_rest, far=run.limbs_far, joints={}, **nothing)


def _parse_row(row: dict[str, Any]) -> PeerRun:
    figures = row["figures"] and Figures(**nan_for_none(row["figures"]))
    return PeerRun(**{**row, "figures": figures})


def summary_table(results: PeerResults) -> Grid:
    """Return a row per program: means over the sequences of the seeds' means."""
    rows = []
    for program in PROGRAMS:
        runs = results.select(program)
        done = [run for run in runs if run.figures is not None]
        if not done:
            continue
        per_sequence = [
            {name: float(np.mean([getattr(r.figures, name) for r in of])) for name in _COLUMNS}
            for of in _by_sequence(done).values()
        ]
        means = {name: float(np.mean([row[name] for row in per_sequence])) for name in _COLUMNS}
        spent = [run.clock if run.cpu is None else run.cpu for run in done]
        seconds = [np.nan if value is None else value for value in spent]
        where = sorted({run.device for run in done})
        rows.append([
            program, str(len(per_sequence)), cell(means["mean"], ".1f"),
            cell(means["rest"], ".1f"), cell(100 * means["far"], ".1f", " %"),
            cell(100 * means["gaps"], ".1f", " %"), cell(means["jitter"], ".2f"),
            cell(means["skating"], ".0f"),
            f"{cell(float(np.mean(seconds)), '.1f')}, {'; '.join(where)}",
            str(len(runs) - len(done)),
        ])  # fmt: skip
    heads = ["program", "sequences", *_HEADS, "seconds", "failed"]
    return Grid("Other programs beside ours, the same keypoints", heads, rows, _about(results))


def _about(results: PeerResults) -> str:
    versions = "; ".join(
        ", ".join(f"{name} {version}" for name, version in of.items())
        for of in results.versions.values()
    )
    commits = ", ".join(sorted({run.commit for run in results.runs}))
    ours = [run for run in results.runs if run.program in _OURS.values()]
    counts = Counter((run.sequence, run.program) for run in ours).values()
    seeds = " to ".join(map(str, sorted({min(counts), max(counts)}))) if counts else "none"
    return f"{_NOTE} {versions}. {results.made}, commit {commits}, seeds of ours: {seeds}."


def sequence_table(results: PeerResults) -> Grid:
    """Return the mean error of each program on each sequence."""
    names = sorted({run.sequence for run in results.runs})
    rows = []
    for program in PROGRAMS:
        by = _by_sequence([run for run in results.select(program) if run.figures is not None])
        if by:
            means = {name: np.mean([r.figures.mean for r in of]) for name, of in by.items()}  # type: ignore[union-attr]
            rest = {name: np.mean([r.figures.rest for r in of]) for name, of in by.items()}  # type: ignore[union-attr]
            shown = [f"{means[n]:.1f} / {rest[n]:.1f}" if n in means else NONE for n in names]
            rows.append([program, *shown])
    return Grid("Mean / offset-free error, mm", ["program", *names], rows)


def _by_sequence(runs: list[PeerRun]) -> dict[str, list[PeerRun]]:
    found: dict[str, list[PeerRun]] = {}
    for run in runs:
        found.setdefault(run.sequence, []).append(run)
    return found


def print_tables(results: PeerResults) -> None:
    summary_table(results).show()
    sequence_table(results).show()


def write_tables(out: Path, results: PeerResults) -> None:
    """Write peers.md and peers.csv, a row per run."""
    failed = [f"- {r.sequence}, {r.program}: {r.failed}" for r in results.runs if r.failed]
    texts = ["# Other programs beside ours", summary_table(results).markdown()]
    texts += [sequence_table(results).markdown(), *(["Failed:", *failed] if failed else [])]
    write_text(out / "peers.md", "\n\n".join(texts) + "\n")
    with write_atomically(out / "peers.csv") as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["sequence", "program", "seed", "device", "commit", *_COLUMNS, "cpu_s",
                         "clock_s", "failed"])  # fmt: skip
        for run in results.runs:
            figures = [getattr(run.figures, name, None) for name in _COLUMNS]
            shown = [f"{v:.5g}" if isinstance(v, float) else v for v in
                     (*figures, run.cpu, run.clock)]  # fmt: skip
            writer.writerow([run.sequence, run.program, run.seed, run.device, run.commit, *shown,
                             run.failed])  # fmt: skip
