"""Measures memory and open files of a long run of reconstruct or track on tiny pictures.

python scripts/measure_memory.py reconstruct --frames 10000 --device numpy
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np
import tomli_w

from apf.body import load_body
from apf.formats.pose import write_pose

_SIZE = (64, 48)
_CAMERAS = 4


def sequence(folder: Path, frames: int) -> None:
    """Write a block that stands and sways, as videos of masks from four sides."""
    tables = {}
    (folder / "masks").mkdir(parents=True)
    for view in range(_CAMERAS):
        angle = 2 * np.pi * view / _CAMERAS + 0.3
        centre = np.array([4 * np.cos(angle), 4 * np.sin(angle), 1.0])
        forward = np.array([0, 0, 0.9]) - centre
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        R = np.stack([right, np.cross(forward, right), forward])
        tables[f"cam{view}"] = {
            "size": list(_SIZE), "matrix": [[70.0, 0, 31.5], [0, 70.0, 23.5], [0, 0, 1]],
            "distortions": [0.0] * 4, "rotation": cv2.Rodrigues(R)[0].ravel().tolist(),
            "translation": (-R @ centre).tolist(),
        }  # fmt: skip
        path = folder / "masks" / f"cam{view}.mp4"
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 30.0, _SIZE)
        for frame in range(frames):
            picture = np.zeros((_SIZE[1], _SIZE[0], 3), np.uint8)
            sway = round(2 * np.sin(frame / 20))
            picture[8:40, 28 + sway : 36 + sway] = 255
            writer.write(picture)
        writer.release()
    (folder / "calibration.toml").write_text(tomli_w.dumps(tables))


def resident(process: int) -> float:
    """Return the resident memory of a process, MiB."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * 4096 / 2**20


def handles(process: int) -> int:
    return sum(1 for _ in Path(f"/proc/{process}/fd").iterdir())


def read_progress(out: Path, command: str) -> int:
    """Return the frame that a run has reached."""
    if command == "reconstruct":
        try:
            return sum(entry.name.endswith(".npz") for entry in os.scandir(out / "clouds"))
        except FileNotFoundError:
            return 0
    try:
        names = [entry.name for entry in os.scandir(out / "parts") if entry.name[0] == "t"]
    except FileNotFoundError:
        return 0
    return max((int(name[6:15]) for name in names), default=0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("command", choices=["reconstruct", "track"])
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--device", default="auto")
    args = parser.parse_args()
    work = Path(tempfile.mkdtemp(prefix="memory"))
    try:
        sequence(work / "seq", args.frames)
        song = load_body("song31")
        write_pose(work / "pose.txt", song.rest_pose, song)
        box = ["--voxel-size", "0.1", "--volume=-0.6,0.6,-0.6,0.6,0,1.9", "--all-cameras"]
        more = ["--init", str(work / "pose.txt"), "--particles", "40", "--layers", "1",
                "--no-overlay", "--no-report"]  # fmt: skip
        program = "psfs" if args.command == "reconstruct" else "apf"
        words = [args.command, str(work / "seq"), "-o", str(work / "out"), *box, "--device",
                 args.device, *(more if args.command == "track" else [])]  # fmt: skip
        code = f"import sys; from {program}.cli import main; sys.exit(main(sys.argv[1:]))"
        process = subprocess.Popen([sys.executable, "-c", code, *words])
        marks = sorted({args.frames // 10, args.frames // 2, args.frames - args.frames // 100})
        began, peak = time.perf_counter(), 0.0
        while process.poll() is None:
            time.sleep(0.5)
            with suppress(OSError, IndexError):  # the process has just ended
                peak = max(peak, resident(process.pid))
            frame = read_progress(work / "out", args.command)
            if marks and frame >= marks[0]:
                marks.pop(0)
                print(f"{args.command}, frame {frame}: {resident(process.pid):.1f} MiB, "
                      f"{handles(process.pid)} open files, {time.perf_counter() - began:.0f} s",
                      flush=True)  # fmt: skip
        print(
            f"at most {peak:.1f} MiB, also at its end; exit code {process.returncode}", flush=True
        )
    finally:
        shutil.rmtree(work)


if __name__ == "__main__":
    main()
