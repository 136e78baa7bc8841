"""Virtual environments of the peers, made by pip from PyPI, each with one program and its own
dependencies."""

from __future__ import annotations

import json
import subprocess
import sys
import venv
from pathlib import Path

from cl import InputError
from psfs.cli.commandline import stderr

#: What is installed for each peer: the versions that this comparison was written for.
PACKAGES: dict[str, tuple[str, ...]] = {
    "pose2sim": ("pose2sim==0.10.49",),
    "aniposelib": ("aniposelib==0.8.0",),
}
#: Versions that are reported beside the results.
_REPORTED = {"pose2sim": ("pose2sim", "opensim", "numpy"), "aniposelib": ("aniposelib", "numpy")}


def make_environment(folder: Path, peer: str) -> Path:
    """Return the Python of a peer's environment in `folder`, made if it is not there. Raises
    InputError if pip fails."""
    home = folder.resolve() / peer
    python = home / "bin" / "python"
    done = home / "installed.json"
    if done.is_file() and json.loads(done.read_text()) == list(PACKAGES[peer]):
        return python
    stderr.print(f"installing {', '.join(PACKAGES[peer])} into {home}")
    if not python.exists():
        venv.create(home, with_pip=True)
    made = subprocess.run(
        [str(python), "-m", "pip", "install", "--quiet", *PACKAGES[peer]],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    if made.returncode:
        last = (made.stderr.strip().splitlines() or ["pip said nothing"])[-1]
        raise InputError(f"{', '.join(PACKAGES[peer])}: cannot be installed: {last}")
    done.write_text(json.dumps(PACKAGES[peer]))
    return python


def list_versions(python: Path, peer: str) -> dict[str, str]:
    """Return the versions of a peer's packages, by name."""
    code = (
        "import json, sys; from importlib.metadata import version; "
        "print(json.dumps({name: version(name) for name in sys.argv[1:]}))"
    )
    return json.loads(_run([str(python), "-c", code, *_REPORTED[peer]]))


def run_script(python: Path, script: str, *arguments: str) -> dict[str, float]:
    """Run one of the scripts beside this file in a peer's environment; return what it prints last,
    as JSON. Raises InputError with its last line if it fails."""
    file = Path(__file__).with_name(script)
    lines = _run([str(python), str(file), *arguments]).strip().splitlines()
    return json.loads(lines[-1])


def _run(command: list[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise InputError(f"{Path(command[1]).name} failed: {last}")
    sys.stdout.flush()
    return done.stdout
