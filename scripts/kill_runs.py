"""Kills reconstruct, track and synth at random times: every visible file must be readable, the next
run must work, and nothing may be left behind.

    python scripts/kill_runs.py [--kills 20] [--seed 1] [--commands reconstruct track synth]
"""

from __future__ import annotations

import argparse
import random
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2

from apf.body import load_body
from apf.evaluation.evaluate import load_truth
from apf.tracking.track import Track
from psfs.common.files import read_json
from psfs.common.outputs import Manifest, find_unfinished_command
from psfs.common.toml import read_toml
from psfs.output.video import count_frames
from psfs.voxels.clouds import read_cloud

_SIZE = ["--cameras", "4", "--frames", "40", "--size", "160x120"]


def commands(work: Path) -> dict[str, list[str]]:
    """Return the commands by name; each writes to a folder of its name."""
    seq, truth = str(work / "sequence"), str(work / "sequence/truth.npz")
    small = ["--all-cameras", "--voxel-size", "0.06"]
    return {
        "reconstruct": ["psfs", "reconstruct", seq, "-o", str(work / "reconstruct"), *small],
        "track": ["apf", "track", seq, "-o", str(work / "track"), "--init", truth, *small,
                  "--particles", "60", "--layers", "4"],
        "synth": ["apf", "synth", "-o", str(work / "synth"), *_SIZE],
    }  # fmt: skip


def check(out: Path) -> int:
    """Read every visible file below a folder; return how many there are. Raises UserError."""
    count = 0
    for path in sorted(out.rglob("*")) if out.is_dir() else ():
        if path.is_dir() or path.name.startswith("."):
            continue
        count += 1
        suffix = path.suffix
        if suffix == ".npz" and path.parent.name == "clouds":
            read_cloud(path)
        elif path.name == "truth.npz" or suffix == ".trc":
            load_truth(path)
        elif suffix == ".npz":
            Track.open(path)
        elif path.name == "body.toml":
            load_body(path)
        elif suffix == ".toml":
            read_toml(path)
        elif suffix == ".json":
            read_json(path, "JSON")
        elif suffix == ".png":
            assert cv2.imread(str(path)) is not None, path
        elif suffix == ".mp4":
            assert count_frames(path) > 0, path
        elif suffix == ".ply":
            assert path.read_bytes().startswith(b"ply"), path
        elif path.name == "manifest.txt":
            Manifest.read(out)
    return count


def start(words: list[str]) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-c", f"import sys; from {words[0]}.cli import main; sys.exit(main())",
         *words[1:]],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip


def done(words: list[str]) -> float:
    """Run to the end and return the seconds that it took."""
    began = time.perf_counter()
    process = start(words)
    _, stdout = process.communicate()
    if process.returncode:
        raise SystemExit(f"{' '.join(words)}: exit code {process.returncode}: {stdout.decode()}")
    return time.perf_counter() - began


def list_hidden(folder: Path) -> list[str]:
    return [str(path) for path in folder.rglob(".psfs-*")]


def state(out: Path) -> int:
    """Return what changes when a run begins to write its folder."""
    manifest = out / "manifest.txt"
    return manifest.stat().st_mtime_ns if manifest.exists() else 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=20, help="while it writes")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--commands", nargs="+", default=["reconstruct", "track", "synth"])
    args = parser.parse_args()
    rng = random.Random(args.seed)
    work = Path(tempfile.mkdtemp(prefix="kill_runs"))
    try:
        done(["apf", "synth", "-o", str(work / "sequence"), *_SIZE])
        for name in args.commands:
            words, out = commands(work)[name], work / name
            seconds = done(words)
            tries = hits = 0
            while hits < args.kills and tries < 5 * args.kills:
                tries += 1
                before = state(out)
                process = start(words)
                time.sleep(rng.uniform(0.05, 1) * seconds)
                process.kill()
                process.communicate()
                writing = bool(list_hidden(work)) or state(out) != before
                hits += process.returncode == -9 and writing
                check(out)
            done(words)
            left = list_hidden(work)
            files = check(out)
            print(
                f"{name}: killed {tries} times within {seconds:.1f} s, {hits} of them while it was "
                "writing; all files readable each time; then whole: "
                f"{find_unfinished_command(out) is None}, {files} files; "
                f"left behind: {left or 'nothing'}",
                flush=True,
            )
    finally:
        shutil.rmtree(work)


if __name__ == "__main__":
    main()
