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
from psfs.common.files import write_atomically
from psfs.sequence import Sequence

ROOT = Path(__file__).resolve().parents[1]
_LIST = ROOT / "scripts" / "site_commands.toml"
_RESULTS = ROOT / "scripts" / "results" / "site_commands.json"
_PAGE = ROOT / "docs" / "lab" / "commands.md"
_SHELLS = ("sh", "bash", "console")
#: The take that commands are run on, and names that pages give it.
_SCENE = SceneConfig(cameras=4, frames=12, fps=30, size=(320, 240), seed=1)
_NAMES = ("FOLDER", "takes/a", "takes/b", "TAKE1", "TAKE2", "suite/walk")
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
    before = json.loads(_RESULTS.read_text())["commands"] if _RESULTS.exists() else []
    known = {(row["page"], row["command"]): row for row in before}
    shown = list_commands()
    work = args.work.resolve()
    if not (work / "walk").exists():
        _prepare(work)
    for one in shown:
        old = known.get((one.page, one.command), {})
        if one.how != "run":
            continue
        if args.only in one.command:
            started = time.monotonic()
            one.exit_code = _execute(one.what, work)
            one.seconds = round(time.monotonic() - started, 1)
            stdout.print(f"{one.exit_code}  {one.seconds:6.1f} s  {one.what}", soft_wrap=True)
        elif old.get("what") == one.what:
            one.exit_code, one.seconds = old["exit_code"], old["seconds"]
    made = {"made": date.today().isoformat(), "commit": checked_out_commit()}
    with write_atomically(_RESULTS) as temporary:
        rows = [asdict(one) for one in shown]
        temporary.write_text(json.dumps({**made, "commands": rows}, indent=1) + "\n")
    with write_atomically(_PAGE) as temporary:
        temporary.write_text(_make_page(shown, **made))
    failed = [one.command for one in shown if one.how == "run" and one.exit_code != 0]
    if failed:
        raise InputError(f"{len(failed)} of {len(shown)} commands fail or were not run: {failed}")


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
    """Run a command in the work folder, `psfs` and `apf` being those of this checkout."""
    starts = [f'{name}() {{ "{sys.executable}" -m {name}.cli "$@"; }}' for name in ("psfs", "apf")]
    starts.append(f'python() {{ "{sys.executable}" "$@"; }}')
    paths = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": paths, "REPOSITORY": str(ROOT)}
    done = subprocess.run(
        ["bash", "-c", "\n".join([*starts, command])], cwd=work, env=environment,
        stdout=subprocess.DEVNULL, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    return done.returncode


def _make_page(shown: list[Shown], made: str, commit: str | None) -> str:
    """Return docs/lab/commands.md."""
    lines = [
        "# Every command of the site",
        "",
        f"Written by `scripts/check_site_commands.py`, {made}, commit {commit}. Run: on a",
        f"synthetic walk of {_SCENE.cameras} cameras, {_SCENE.frames} frames of {_SCENE.size[0]} x "
        f"{_SCENE.size[1]}, in the order of this table. A test runs a",
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
