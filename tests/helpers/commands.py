"""Commands: what their words state, and what they say, run in this process."""

import contextlib
import io
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import apf.cli
import psfs.cli
from apf.cli.commands import COMMANDS
from apf.request import TrackRequest
from psfs.cli.program import find_stated, program_parser
from psfs.common.requests import Stated


def state_track(*words: str) -> Stated:
    """What the words behind `apf track` state."""
    args = program_parser("apf", "", COMMANDS).parse_args(["track", *words])
    return find_stated(TrackRequest, args)


@dataclass(frozen=True)
class Outcome:
    """The result of a command."""

    code: int
    out: str
    err: str


def run(program: str, *words: str | Path) -> Outcome:
    """Run `psfs ...` or `apf ...`."""
    main = {"psfs": psfs.cli.main, "apf": apf.cli.main}[program]
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main([str(word) for word in words])
    return Outcome(code, out.getvalue(), err.getvalue())


def succeed(*words: str | Path) -> Outcome:
    """Run a command that must succeed."""
    outcome = run(*words)
    assert outcome.code == 0, outcome
    return outcome


def fail(*words: str | Path) -> str:
    """Run a command that must end with exit code 2; return what it says."""
    outcome = run(*words)
    assert outcome.code == 2, outcome
    return outcome.err


def run_python(*words: str | Path, **environment: str | None) -> Outcome:
    """Run Python in a process of its own, with the modules found here; None is no variable."""
    modules = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    known = {k: v for k, v in {**os.environ, **modules, **environment}.items() if v is not None}
    done = subprocess.run(
        [sys.executable, *words], env=known, capture_output=True, text=True, check=False
    )
    return Outcome(done.returncode, done.stdout, done.stderr)
