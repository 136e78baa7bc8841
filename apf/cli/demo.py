"""`apf demo`: the whole way on data it makes itself."""

from __future__ import annotations

import argparse
import json
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np

import psfs.cli
from apf.cli import evaluate, synth, track
from apf.synthetic.scene import SceneConfig
from psfs.cli.commandline import add_command, add_device_flag, stdout
from psfs.cli.program import run_program
from psfs.common.files import write_json
from psfs.common.outputs import output_folder
from psfs.common.ranges import check_number


def register(commands: argparse._SubParsersAction) -> None:
    parser = add_command(
        commands,
        "demo",
        run,
        "Generate a small sequence, reconstruct, track and evaluate it, by the commands shown.",
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("demo"), metavar="FOLDER")
    parser.add_argument("--frames", type=int, default=60, metavar="N")
    parser.add_argument("--cameras", type=int, default=4, metavar="N")
    add_device_flag(parser)


def run(args: argparse.Namespace) -> None:
    out = args.output
    check_number("--cameras", args.cameras, 2, 64)  # a hull needs two
    SceneConfig(cameras=args.cameras, frames=args.frames)  # which complains
    with output_folder(out, args.parser.prog) as opened:
        opened.begin()  # the summary of an earlier demo does not stand beside new results
        _demonstrate(args, out)


def _demonstrate(args: argparse.Namespace, out: Path) -> None:
    sequence, voxels, tracked = (str(out / name) for name in ("sequence", "voxels", "track"))
    truth = str(out / "sequence" / "truth.npz")
    device = ["--device", args.device]
    size = ["--cameras", str(args.cameras), "--frames", str(args.frames)]
    _step("apf", _apf, ["synth", "-o", sequence, *size, *device])
    _step("psfs", psfs.cli.main, ["reconstruct", sequence, "-o", voxels, *device])
    _step("psfs", psfs.cli.main, ["check", voxels, *device])
    _step("apf", _apf, ["track", sequence, "-o", tracked, *device])
    _step("apf", _apf, ["evaluate", tracked, "--truth", truth])
    write_json(out / "summary.json", _summary(out))
    stdout.print(
        f"{out}: track/report.html, overlay.mp4, joints.trc, track.npz, voxels/preview.png, clouds "
        "and evaluation.png, summary.json"
    )


def _apf(argv: list[str]) -> int:
    return run_program("apf", "The commands of the demo.", (synth, track, evaluate), argv)


def _step(program: str, main: Callable[[list[str]], int], argv: list[str]) -> None:
    stdout.print(f"$ {program} {shlex.join(argv)}", style="bold", soft_wrap=True)
    code = main(argv)
    if code:
        raise SystemExit(code)  # the command has printed what is wrong


def _summary(out: Path) -> dict[str, object]:
    """The demo's figures, from the files that its commands wrote."""
    voxels = json.loads((out / "voxels" / "summary.json").read_text())
    check = json.loads((out / "voxels" / "check.json").read_text())
    evaluation = json.loads((out / "track" / "evaluation.json").read_text())
    return {
        "mean_error_mm": evaluation["mean_error_mm"],
        "lost_limbs": evaluation["lost_limbs"],
        "silhouette_iou": check["mean_iou"],
        "frames": len(voxels["frames"]),
        "device": voxels["device"]["name"],
        "surface_voxels": float(np.median([frame["surface_voxels"] for frame in voxels["frames"]])),
    }
