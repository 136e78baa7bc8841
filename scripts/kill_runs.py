"""Kills commands at random times: every visible file must be readable, the next run must work, and
nothing may be left behind, neither beside the results nor in the temporary directory.

    python scripts/kill_runs.py [--kills 20] [--seed 1] [--commands reconstruct convert ...]

With `--interrupt` the commands are interrupted as by Ctrl-C instead: besides, they must end with
exit code 130 (or 0, if they were done) and one line without a traceback.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
import psutil

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from helpers import calibration as made

from apf.body import load_body
from apf.evaluation.evaluate import load_truth
from apf.formats.c3d import read_c3d
from apf.tracking.track import Track
from psfs.cameras.calibration.toml_tables import write_toml_tables
from psfs.cameras.camera import CameraRig
from psfs.common.files import read_json
from psfs.common.outputs import Manifest, find_unfinished_command
from psfs.common.toml import read_toml
from psfs.output.video import count_frames
from psfs.voxels.clouds import read_cloud

_SIZE = ["--cameras", "4", "--frames", "20", "--size", "96x72"]
#: s that workers have to end after their command.
_PATIENCE = 10.0


def list_commands(work: Path) -> dict[str, list[str]]:
    """Return the commands by name; each writes to a folder of its name."""
    seq, truth = str(work / "sequence"), str(work / "sequence/truth.npz")
    small = ["--all-cameras", "--voxel-size", "0.06"]
    search = ["--particles", "60", "--layers", "4"]
    wand = ["--wand", "0.5", "--intrinsics", str(work / "wand/lens.toml"), "--floor", "0:2"]

    def out(name: str) -> list[str]:
        return ["-o", str(work / name)]

    return {
        "reconstruct": ["psfs", "reconstruct", seq, *out("reconstruct"), *small],
        "track": ["apf", "track", seq, *out("track"), "--init", truth, *small, *search],
        "synth": ["apf", "synth", *out("synth"), *_SIZE],
        "convert": ["psfs", "convert", seq, *out("convert")],
        "smooth": ["apf", "smooth", str(work / "track"), *out("smooth")],
        "export": ["apf", "export", str(work / "track"), *out("export")],
        "calibrate": ["psfs", "calibrate", str(work / "wand"), *out("calibrate"), *wand],
        "batch": ["apf", "batch", seq, str(work / "other"), *out("batch"), "--init", truth,
                  "--workers", "2", *small, *search],
    }  # fmt: skip


def make_inputs(work: Path, names: list[str]) -> None:
    """Make the footage, and the track, that the commands read."""
    run_whole(["apf", "synth", "-o", str(work / "sequence"), *_SIZE], work)
    if "batch" in names:
        shutil.copytree(work / "sequence", work / "other")
    if {"smooth", "export"} & {*names}:
        run_whole(list_commands(work)["track"], work)
    if "calibrate" in names:
        cameras, rng = made.ring(size=(160, 120), focal=126.0), np.random.default_rng(2)
        points = np.array([[0, 0, 0], [0.5, 0, 0]])
        poses = [made.flat(0.0), made.flat(1.5, 0.4), *(made.anyhow(rng) for _ in range(50))]
        made.film(work / "wand", cameras, poses, made.wand_picture(points, noise=0.1))
        write_toml_tables(work / "wand/lens.toml", CameraRig(tuple(made.unplaced(cameras))))


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
        elif suffix == ".c3d":
            read_c3d(path)
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


def start(words: list[str], work: Path) -> subprocess.Popen:
    temporary = work / "temporary"
    temporary.mkdir(exist_ok=True)
    return subprocess.Popen(
        [sys.executable, "-c", f"import sys; from {words[0]}.cli import main; sys.exit(main())",
         *words[1:]],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True,
        env={**os.environ, "TMPDIR": str(temporary)},
    )  # fmt: skip


def run_whole(words: list[str], work: Path) -> float:
    """Run to the end and return the seconds that it took."""
    began = time.perf_counter()
    process = start(words, work)
    _, stderr = process.communicate()
    if process.returncode:
        raise SystemExit(f"{' '.join(words)}: exit code {process.returncode}: {stderr.decode()}")
    return time.perf_counter() - began


def find_leftovers(work: Path) -> list[str]:
    """Return hidden files anywhere, and all that lies in the temporary directory."""
    found = {*work.rglob(".psfs-*"), *(work / "temporary").iterdir()}
    return sorted(str(path.relative_to(work)) for path in found)


def read_state(out: Path) -> int:
    """Return what changes when a run begins to write its folder."""
    manifest = out / "manifest.txt"
    return manifest.stat().st_mtime_ns if manifest.exists() else 0


def stop(process: subprocess.Popen, interrupt: bool) -> str:
    """Kill or interrupt the process, as a terminal does with all of its session. Return what is
    wrong with its end, or nothing."""
    workers = psutil.Process(process.pid).children(recursive=True)
    if interrupt:
        os.killpg(process.pid, signal.SIGINT)
    else:
        process.kill()
    _, stderr = process.communicate()
    _, alive = psutil.wait_procs(workers, timeout=_PATIENCE)
    wrong = [f"{len(alive)} workers live on"] if alive else []
    for worker in alive:
        worker.kill()
    text = stderr.decode()
    if interrupt and (process.returncode not in (0, 130) or "Traceback" in text):
        wrong.append(f"exit code {process.returncode}: {text.strip()[-2000:]}")
    return "; ".join(wrong)


def try_command(name: str, work: Path, moments: list[float], interrupt: bool) -> dict[str, object]:
    """Stop a command at `moments`, shares of the time that it takes, then run it to the end."""
    words, out = list_commands(work)[name], work / name
    seconds = run_whole(words, work)
    hits, wrong = 0, []
    for share in moments:
        if interrupt or name == "batch":  # or a second batch has nothing to start workers for
            shutil.rmtree(out, ignore_errors=True)
        before = read_state(out)
        process = start(words, work)
        time.sleep(share * seconds)
        if process.poll() is None:
            fault = stop(process, interrupt)
            wrong += [f"at {share * seconds:.2f} s: {fault}"] if fault else []
            hits += bool(find_leftovers(work)) or read_state(out) != before
        else:
            process.communicate()
        check(out)
    run_whole(words, work)
    return {
        "command": name,
        "seconds": round(seconds, 1),
        "stopped": len(moments),
        "while it wrote": hits,
        "wrong": wrong,
        "files": check(out),
        "whole": find_unfinished_command(out) is None,
        "left behind": find_leftovers(work),
    }


def main() -> None:
    work = Path(tempfile.mkdtemp(prefix="kill_runs"))
    names = list(list_commands(work))
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--commands", nargs="+", default=names, choices=names, metavar="NAME")
    parser.add_argument("--interrupt", action="store_true", help="as Ctrl-C does")
    parser.add_argument("--since", type=float, default=0.05, help="share of the time that it takes")
    parser.add_argument("--until", type=float, default=1.0, help="share of the time that it takes")
    args = parser.parse_args()
    rng = random.Random(args.seed)
    try:
        make_inputs(work, args.commands)
        for name in args.commands:
            moments = [rng.uniform(args.since, args.until) for _ in range(args.kills)]
            found = try_command(name, work, moments, args.interrupt)
            print("; ".join(f"{key}: {value}" for key, value in found.items()), flush=True)
    finally:
        shutil.rmtree(work)


if __name__ == "__main__":
    main()
