#!/usr/bin/env python3
"""Run every command that README and the site show, on a small synthetic take, and list them.

    scripts/check_site_commands.py [--only TEXT] [--work FOLDER]

writes scripts/results/site_commands.json (command, how it was checked, exit code, seconds, commit)
and the table of docs/lab/commands.md. `scripts/site_commands.toml` says for each command what is
run in its place, such as fewer frames or other names of folders, or which test runs it, or why and
when it was tried by hand.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path

import numpy as np
import tomllib
from timings.results import checked_out_commit

from apf.synthetic.generate import generate
from apf.synthetic.scene import SceneConfig
from cl import Device, InputError
from psfs.cli.commandline import add_message_flags, stdout
from psfs.cli.program import run_command
from psfs.common.files import write_atomically, write_text
from psfs.sequence import Sequence

ROOT = Path(__file__).resolve().parents[1]
_LIST = ROOT / "scripts" / "site_commands.toml"
_RESULTS = ROOT / "scripts" / "results" / "site_commands.json"
_PAGE = ROOT / "docs" / "lab" / "commands.md"
_SHELLS = ("sh", "bash", "console")
#: The take that commands are run on, names that pages give it, and copies for commands on several.
_SCENE = SceneConfig(cameras=4, frames=12, fps=30, size=(320, 240), seed=1)
_NAMES = ("FOLDER", "TAKE1", "takes/a", "suite/walk")
_COPIES = ("TAKE2", "takes/b")
#: Joints of the truth by the names of a pose network.
_KEYPOINTS = {
    f"{side}_{joint}": f"{side[0]}_{joint}"
    for side in ("left", "right")
    for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
}


@dataclass
class Shown:
    """A command of a page and how it was checked: "run", "test" or "hand". what: the command that
    was run, the test, or the note. exit_code, seconds: of a run."""

    page: str
    command: str
    how: str
    what: str
    exit_code: int | None = None
    seconds: float | None = None


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="check_site_commands.py", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--only", default="", metavar="TEXT", help="run those that contain it")
    parser.add_argument("--work", type=Path, default=Path("site-commands"), metavar="FOLDER")
    add_message_flags(parser)
    parser.set_defaults(run=_run, overwrite=True)  # its own tables, in any checkout
    return run_command(parser)


def _run(args: argparse.Namespace) -> None:
    """Run the commands that contain `--only`; keep what is known of the others."""
    before = json.loads(_RESULTS.read_text())["commands"] if _RESULTS.exists() else []
    known = {row["what"]: (row["exit_code"], row["seconds"]) for row in before}
    shown = list_commands()
    work = args.work.resolve()
    if not (work / "walk").exists():
        _prepare(work)
    runs = list(dict.fromkeys(one.what for one in shown if one.how == "run"))
    try:
        for what in runs:
            if args.only in what:
                started = time.monotonic()
                code = _execute(what, work)
                known[what] = (code, round(time.monotonic() - started, 1))
                stdout.print(f"{code}  {known[what][1]:6.1f} s  {what}", soft_wrap=True)
    finally:  # write what was run, also after an interrupt
        for one in shown:
            if one.how == "run":
                one.exit_code, one.seconds = known.get(one.what, (None, None))
        _write_results(shown)
    failed = [what for what in runs if known.get(what, (None, 0))[0] != 0]
    if failed:
        raise InputError(f"{len(failed)} of {len(runs)} commands fail or were not run: {failed}")


def _write_results(shown: list[Shown]) -> None:
    """Write the results and the page."""
    # Its own results are what makes the checkout dirty.
    made, commit = date.today().isoformat(), (checked_out_commit() or "").removesuffix("-dirty")
    with write_atomically(_RESULTS) as temporary:
        rows = [asdict(one) for one in shown]
        text = json.dumps({"made": made, "commit": commit, "commands": rows}, indent=1)
        temporary.write_text(text + "\n")
    write_text(_PAGE, _make_page(shown, made, commit))


def find_commands() -> Iterator[tuple[str, str]]:
    """Yield page and command of every line of the shell's in README, CONTRIBUTING and docs/."""
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
    for page in pages:
        for kind, block in re.findall(r"```(\w*)\n(.*?)```", page.read_text(), re.DOTALL):
            if kind not in _SHELLS:
                continue
            for line in block.replace("\\\n", " ").splitlines():
                command = " ".join(re.sub(r"(^|\s)#.*", "", line).split())
                if command:
                    yield page.relative_to(ROOT).as_posix(), command


def list_commands() -> list[Shown]:
    """Return all commands in the order of the pages' list. Raises InputError if one is not in
    site_commands.toml, or one there is on no page."""
    listed = tomllib.loads(_LIST.read_text())
    kinds = ("run", "test", "hand")
    known = {command: (how, what) for how in kinds for command, what in listed[how].items()}
    found = list(find_commands())
    lacking = [command for _, command in found if command not in known]
    gone = [command for command in known if command not in {c for _, c in found}]
    if lacking or gone:
        raise InputError(f"{_LIST.name}: lacks {lacking}, and has {gone}, which no page shows")
    order = {command: place for place, command in enumerate(known)}
    shown = [
        Shown(page, command, known[command][0], known[command][1] or command)
        for page, command in found
    ]
    return sorted(shown, key=lambda one: order[one.command])


def _prepare(work: Path) -> None:
    """Make the take, links by the names that pages use, and keypoints from the truth."""
    generate(work / "walk", _SCENE, Device.best())
    for name in _NAMES:
        link = work / name
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(work / "walk")
    for name in _COPIES:
        shutil.copytree(work / "walk", work / name)
    (work / "JOINTS.npz").symlink_to(work / "walk" / "truth.npz")
    rig = Sequence.open(work / "walk").rig
    with np.load(work / "walk" / "truth.npz") as truth:
        names = list(truth["joint_names"])
        places = truth["joints"][:, [names.index(name) for name in _KEYPOINTS.values()]]
    points = np.stack([camera.project(places)[0] for camera in rig])
    seen = np.concatenate([points, np.ones((*points.shape[:3], 1))], -1).astype(np.float32)
    np.savez(
        work / "walk" / "keypoints.npz", keypoints=seen, keypoint_names=np.array(list(_KEYPOINTS)),
        camera_names=np.array(rig.names),
    )  # fmt: skip
    (work / "PATH").symlink_to(work / "walk" / "keypoints.npz")


def _execute(command: str, work: Path) -> int:
    """Run a command in the work folder, `psfs`, `apf` and `python` being those of this checkout."""
    for name in ("psfs", "apf", "python"):
        program = work / "bin" / name
        program.parent.mkdir(exist_ok=True)
        module = "" if name == "python" else f" -m {name}.cli"
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}"{module} "$@"\n')
        program.chmod(0o755)
    environment = {
        **os.environ,
        "PATH": os.pathsep.join([str(work / "bin"), os.environ.get("PATH", "")]),
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
        "REPOSITORY": str(ROOT),
    }
    done = subprocess.run(
        ["bash", "-c", command], cwd=work, env=environment,
        stdout=subprocess.DEVNULL, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    return done.returncode


def _make_page(shown: list[Shown], made: str, commit: str) -> str:
    """Return docs/lab/commands.md."""
    lines = [
        "# Every command of the site",
        "",
        f"Written by `scripts/check_site_commands.py`, {made}, the last at commit {commit}.",
        f"Run: on a synthetic walk of {_SCENE.cameras} cameras, {_SCENE.frames} frames of "
        f"{_SCENE.size[0]} x {_SCENE.size[1]}, in the order of this table. A test runs a",
        "command of that kind on its own input; what neither can run was tried by hand.",
        "",
        "| command | pages | checked | exit code |",
        "|---|---|---|--:|",
    ]
    pages: dict[str, list[str]] = {}
    for one in shown:
        pages.setdefault(one.command, []).append(one.page.removeprefix("docs/"))
    for one in {one.command: one for one in shown}.values():
        what = f"`{one.what}`" if one.how == "test" else one.what
        if one.how == "run":
            what = "run" if one.what == one.command else f"run as `{one.what}`"
        code = "" if one.exit_code is None else str(one.exit_code)
        cells = [f"`{one.command}`", ", ".join(dict.fromkeys(pages[one.command])), what, code]
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
