"""The results' files: one envelope for all comparisons, written section by section.

    results = Results.begin("psfs", args, {"views": 8})
    results.plan("growth", lambda: growth(...))
    results.measure()

OUT/psfs.json then holds what was measured where, with what and by which command; a planned section
that was not reached, has no time left (`--seconds`) or lacks something optional is named under
`left_out` with the reason, and `--resume` measures what a file still lacks. Times are `Timing`s
with all raw samples.
"""

from __future__ import annotations

import argparse
import json
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass, field, is_dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from apf.timings.measure import Timing
from cl import InputError
from psfs.cli.commandline import stderr
from psfs.common.config import Config
from psfs.common.files import write_text
from timings.measure import Limits, environment

#: Version of the format, raised when a reader of older files would misunderstand newer ones.
SCHEMA = 1
_ENVELOPE = (
    *("schema", "comparison", "made", "command", "commit", "environment", "settings"),
    *("sections", "seconds", "left_out"),
)


def add_command(
    commands: argparse._SubParsersAction,
    name: str,
    run: Callable[[argparse.Namespace], None],
    help: str,
) -> argparse.ArgumentParser:
    """Add a subcommand."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=help, description=help, allow_abbrev=False
    )
    parser.set_defaults(run=run, command=name)
    return parser


def add_timing_flags(parser: argparse.ArgumentParser) -> None:
    """Add the flags that all comparisons have."""
    parser.add_argument(
        *("-o", "--out"), type=Path, default=Path("timings"), metavar="OUT",
        help="folder of the results (default: timings)",
    )  # fmt: skip
    parser.add_argument(
        "--quick", action="store_true", help="what tells most, with fewer runs and frames"
    )
    parser.add_argument(
        "--seconds", type=float, metavar="S", help="start nothing more after so many seconds"
    )
    parser.add_argument(
        "--resume", action="store_true", help="keep what OUT holds; measure only what it lacks"
    )
    parser.add_argument("--commit", help="the commit, where there is no git to ask")


@dataclass
class Results:
    """One comparison's results. sections: results of `section`, by name. seconds: duration of each.
    left_out: name -> reason. budget: in seconds, `--seconds`. `path` None: kept in memory."""

    comparison: str
    settings: dict[str, Any]
    path: Path | None = None
    environment: dict[str, Any] = field(default_factory=environment)
    made: str = ""
    command: str = ""
    commit: str | None = None
    schema: int = SCHEMA
    sections: dict[str, Any] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)
    budget: float = float("inf")
    deadline: float = float("inf")
    planned: list[tuple[str, Callable[[], Any], bool]] = field(default_factory=list)

    @classmethod
    def begin(
        cls, comparison: str, args: argparse.Namespace, settings: Mapping[str, Any]
    ) -> Results:
        """Begin the file OUT/<comparison>.json; with `--resume`, continue it.

        Raises InputError if OUT is not a folder, or if the results to resume have other settings.
        """
        if args.out.exists() and not args.out.is_dir():
            raise InputError(f"{args.out} is a file; expected a folder, or a name for a new one")
        path = args.out / f"{comparison}.json"
        kept = _round_trip({**settings, "quick": args.quick})
        results = cls(
            comparison, kept, path, commit=args.commit or checked_out_commit(),
            made=datetime.now(timezone.utc).isoformat(timespec="seconds"),
            command=shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        )  # fmt: skip
        if args.resume and path.is_file():
            before = read_results(path)
            same = ("schema", "comparison", "settings", "commit")
            for name in same:
                if getattr(before, name) != getattr(results, name):
                    raise InputError(
                        f"{path}: {name} is {getattr(before, name)}; expected "
                        f"{getattr(results, name)} to resume, or no --resume"
                    )
            results.sections, results.seconds = before.sections, before.seconds
        if args.seconds is not None:
            results.budget = args.seconds
            results.deadline = time.monotonic() + args.seconds
        return results

    @property
    def seconds_left(self) -> float:
        return self.deadline - time.monotonic()

    def plan(self, name: str, measure: Callable[[], Any], quick: bool = True) -> None:
        """Add a `section` of that name, to be measured by `measure` in its turn."""
        self.planned.append((name, measure, quick))

    def measure(self) -> None:
        """Measure the planned sections in order. Until then the file lists them as left out, so
        that an interrupted run shows what it did not reach."""
        for name, _, _ in self.planned:
            if name not in self.sections:
                self.left_out[name] = "not reached; --resume measures it"
        self.write()
        for planned in self.planned:
            self.section(*planned)

    def section(self, name: str, measure: Callable[[], Any], quick: bool = True) -> Any:
        """Return the result of `measure()`, as read back from the file; None if it is left out.

        An InputError, a missing module or a crashed subprocess leaves the section out; so does
        `--quick` if it is not `quick`.
        """
        if name in self.sections:
            return self.sections[name]
        started = time.monotonic()
        try:
            if self.settings["quick"] and not quick:
                raise InputError("not with --quick")
            if self.seconds_left <= 0:
                raise InputError("no time left; --resume measures it")
            stderr.print(f"measuring: {self.comparison}, {name}")
            self.sections[name] = _round_trip(measure())
            self.seconds[name] = round(time.monotonic() - started, 2)
            self.left_out.pop(name, None)
        except (InputError, ImportError, BrokenProcessPool) as error:
            self.left_out[name] = str(error).splitlines()[0]
            stderr.print(f"left out: {name}: {self.left_out[name]}")
        self.write()
        return self.sections.get(name)

    def starting(self, prefix: str) -> list[Any]:
        """Return the sections whose names begin with `prefix`, in their order."""
        return [value for name, value in self.sections.items() if name.startswith(prefix)]

    def write(self) -> None:
        if self.path is not None:
            text = json.dumps({k: getattr(self, k) for k in _ENVELOPE}, indent=1, default=_plain)
            write_text(self.path, text + "\n")


def read_results(path: Path) -> Results:
    """Read a file that `Results` wrote. Raises InputError if it is none, or of another version."""
    try:
        data = json.loads(path.read_text(), object_hook=_revive)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError:
        raise InputError(f"{path}: no JSON; expected results of compare_timings.py") from None
    if not isinstance(data, dict) or set(data) != set(_ENVELOPE):
        raise InputError(f"{path}: expected results of compare_timings.py ({', '.join(_ENVELOPE)})")
    if data["schema"] != SCHEMA:
        raise InputError(f"{path}: schema {data['schema']}; expected {SCHEMA}")
    return Results(path=path, **data)


def _round_trip(value: Any) -> Any:
    return json.loads(json.dumps(value, default=_plain), object_hook=_revive)


def _plain(value: Any) -> Any:
    """Convert NumPy values, timings (with their statistics), dataclasses and settings to JSON
    types."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if isinstance(value, Timing):
        short = {name: round(getattr(value, name), 5) for name in ("median", "low", "high")}
        return {"samples_ms": [round(ms, 5) for ms in value.samples], **short}
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if isinstance(value, Config):
        return value.to_dict()
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")


def _revive(value: dict[str, Any]) -> Any:
    if "samples_ms" in value:
        return Timing(tuple(value["samples_ms"]))
    if set(value) == {"bytes_per_s", "flops_per_s"}:
        return Limits(**value)
    return value


def checked_out_commit() -> str | None:
    """Return the commit of the checkout that holds this file; with "-dirty" if it has changes."""
    command = ["git", "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    try:
        done = subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True)
    except OSError:
        return None
    return done.stdout.strip() or None
