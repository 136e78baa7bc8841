"""`apf demo`: the whole pipeline on synthetic data that it generates."""

from __future__ import annotations

import logging
import shlex
import webbrowser
from collections.abc import Callable
from pathlib import Path

import numpy as np

import apf.cli
import psfs.cli
from apf.request import DemoRequest
from cl import InputError, NumpyDevice, select_device
from psfs.cli.commandline import stdout
from psfs.common.files import read_json, write_json
from psfs.common.outputs import output_folder
from psfs.common.ranges import check_number

log = logging.getLogger(__name__)


def run(request: DemoRequest) -> None:
    out = request.output
    check_number("--cameras", request.scene.cameras, 2, 64)  # a visual hull needs two
    device = select_device(request.device)  # held, so that its programs serve all steps
    if isinstance(device, NumpyDevice):
        raise InputError("--device numpy renders no scene; expected an OpenCL device")
    with output_folder(out, request.COMMAND) as opened:
        opened.begin()  # remove the summary of an earlier demo before new results are written
        _demonstrate(request, out)


def _demonstrate(request: DemoRequest, out: Path) -> None:
    sequence, voxels, tracked = (str(out / name) for name in ("sequence", "voxels", "track"))
    scene = request.scene
    truth = str(out / "sequence" / "truth.npz")
    device = ["--device", request.device]
    flags = ["--cameras", scene.cameras, "--frames", scene.frames, "--seed", scene.seed]
    _step("apf", apf.cli.main, ["synth", "-o", sequence, *map(str, flags), *device])
    _step("psfs", psfs.cli.main, ["reconstruct", sequence, "-o", voxels, *device])
    _step("psfs", psfs.cli.main, ["check", voxels, *device])
    _step("apf", apf.cli.main, ["track", sequence, "-o", tracked, *device])
    _step("apf", apf.cli.main, ["evaluate", tracked, "--truth", truth])
    write_json(out / "summary.json", _summary(out))
    report = out / "track" / "report.html"
    stdout.print(
        f"Look at {report} (the track, judged), {out / 'track' / 'overlay.mp4'} and "
        f"{out / 'voxels' / 'preview.png'}; {out / 'summary.json'} has the figures.\n"
        "Your own footage: `psfs info FOLDER` says what is missing or looks wrong, then `apf track "
        "FOLDER -o OUT` and `apf export OUT`."
    )
    if request.open and not webbrowser.open(report.resolve().as_uri()):
        log.warning("no browser to open %s with", report)


def _step(program: str, main: Callable[[list[str]], int], argv: list[str]) -> None:
    stdout.print(f"$ {program} {shlex.join(argv)}", style="bold")
    code = main(argv)
    if code:
        raise SystemExit(code)  # the command has printed the error


def _summary(out: Path) -> dict[str, object]:
    """Return the demo's figures, from the files that its commands wrote."""
    voxels = read_json(out / "voxels" / "summary.json", "a summary")
    check = read_json(out / "voxels" / "check.json", "the figures of a check")
    evaluation = read_json(out / "track" / "evaluation.json", "an evaluation")
    return {
        "mean_error_mm": evaluation["mean_error_mm"],
        "lost_limbs": evaluation["lost_limbs"],
        "silhouette_iou": check["mean_iou"],
        "frames": len(voxels["frames"]),
        "device": voxels["device"]["name"],
        "surface_voxels": float(np.median([frame["surface_voxels"] for frame in voxels["frames"]])),
    }
