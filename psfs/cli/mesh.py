"""`psfs mesh OUT`: closed, smooth surfaces of the reconstructed frames."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from cl import InputError, select_device
from psfs.cli.check import iou_table
from psfs.cli.commandline import progress_bar, stdout, warn
from psfs.common.files import resolve_path, write_json
from psfs.common.numbers import json_number
from psfs.common.outputs import output_folder
from psfs.common.regions import iou
from psfs.diagnostics.reprojection_iou import Checker
from psfs.mesh.config import FORMATS
from psfs.mesh.marching_cubes import Mesher, write_mesh
from psfs.mesh.preview import load_open3d, mesh_silhouette
from psfs.output.reconstruction_folder import ReconstructionFolder
from psfs.request import MESH_DEFINITION, MeshRequest
from psfs.session import Session, SessionSettings

#: What --check writes.
_REPORT = "mesh_check.json"


def run(request: MeshRequest) -> None:
    if request.check:
        load_open3d()  # says what is missing before the work
    run = ReconstructionFolder.open(request.out)
    run.warn_if_unfinished(warn)
    expected, targets = (_REPORT,) if request.check else (), _targets(request, run)
    with ExitStack() as stack:
        stack.enter_context(
            output_folder(request.out, request.COMMAND, expected=expected, addition=True)
        )
        if request.frame == "all" and request.output is not None:
            stack.enter_context(output_folder(request.output, request.COMMAND, run.inputs))
        _mesh(request, run, targets)


def _mesh(request: MeshRequest, run: ReconstructionFolder, targets: dict[int, Path]) -> None:
    device, sequence = select_device(request.device), run.sequence()
    mesher = Mesher(device, run, sequence, request.smooth)
    session = Session(sequence, device, SessionSettings(run.config))
    checker = Checker(session, run.grid) if request.check else None
    checks = {}
    with progress_bar() as bar:
        for index, path in bar.track(targets.items(), len(targets), description="meshing"):
            mesh = mesher(index)
            write_mesh(mesh, path)
            if checker is not None:
                scores = []  # IoU (V,), NaN if there is nothing to compare
                shown = checker.silhouettes(sequence.read(index))
                for camera, silhouette in zip(checker.rig, shown, strict=True):
                    ours = np.zeros_like(silhouette)
                    ours[: camera.size[1], : camera.size[0]] = mesh_silhouette(mesh, camera)
                    scores.append(iou(ours, silhouette))
                checks[index] = {
                    "watertight": mesh.is_watertight, "volume_m3": mesh.volume, "iou": scores,
                }  # fmt: skip
    if checks:
        _report(request.out, sequence.rig.names, checks)
    path = next(iter(targets.values()))
    what = f"{path.parent}: {len(targets)} meshes" if request.frame == "all" else str(path)
    stdout.print(f"wrote {what}")


def _targets(request: MeshRequest, run: ReconstructionFolder) -> dict[int, Path]:
    """Return the path of every frame's mesh."""
    if request.frame == "all":
        full = [int(f["index"]) for f in run.summary["frames"] if f["surface_voxels"]]
        folder = request.output or request.out / "meshes"
        named_file = folder.suffix.lower().lstrip(".") in FORMATS and not folder.exists()
        if named_file or (folder.exists() and not folder.is_dir()):
            raise InputError(f"{folder} is a file; --frame all expects a folder")
        if not full:
            raise InputError(f"{request.out}: all clouds are empty; expected a body")
        return {n: folder / f"frame_{n:06d}.{request.format or FORMATS[0]}" for n in full}
    frame = request.frame
    number = run.choose_frame(frame if isinstance(frame, int) else None)
    path = request.output
    if path is None:
        path = request.out / "meshes" / f"frame_{number:06d}.{request.format or FORMATS[0]}"
    elif not path.suffix and request.format:
        path = path.with_suffix(f".{request.format}")
    suffix = path.suffix.lower().lstrip(".")
    if suffix not in FORMATS or suffix != (request.format or suffix):
        expected = [request.format] if request.format else FORMATS
        raise InputError(f"{path}: expected a name that ends in .{' or .'.join(expected)}")
    if resolve_path(path).parent == resolve_path(request.out / "clouds"):
        raise InputError(f"{path}: lies among the clouds, which are read; expected another folder")
    return {number: path}


def _report(out: Path, names: list[str], checks: dict[int, dict[str, Any]]) -> None:
    scores = np.ma.masked_invalid([check["iou"] for check in checks.values()])
    stdout.print(iou_table("IoU of mesh and silhouettes", names, scores))
    closed = sum(check["watertight"] for check in checks.values())
    stdout.print(f"{closed} of {len(checks)} meshes are watertight")
    report = {
        "definition": MESH_DEFINITION,
        "mean_iou": json_number(scores.mean()),
        "cameras": names,
        "frames": {
            str(index): {**check, "iou": [json_number(score) for score in check["iou"]]}
            for index, check in checks.items()
        },
    }
    write_json(out / _REPORT, report)
