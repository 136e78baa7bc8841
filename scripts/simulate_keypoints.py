#!/usr/bin/env python3
"""Make keypoints, with a pose network's errors, of a sequence that has only its truth.

    scripts/simulate_keypoints.py SEQUENCE -o keypoints.npz --like SEQUENCE ...

The sequences of --like have truth.npz and a pose network's keypoints. Of these, the network's
constant offsets from the true joints are estimated in the body's own frame; what remains, in metres
at the person's distance, is played back, and each new camera takes it from another old one. Cameras
are those of truth_calibration.toml, if there is one, and joints those at the cameras' own times.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from apf.keypoints import Keypoints, triangulate
from psfs.cameras.camera import CameraRig
from psfs.cameras.triangulation import TriangulationConfig
from psfs.cli.commandline import add_message_flags, stdout
from psfs.cli.program import run_command
from psfs.common.files import write_atomically
from psfs.sequence import Sequence

#: True joints nearest to a network's points; each of the second row has a left and a right one.
JOINTS = {"nose": "head_top"} | {
    f"{side}_{point}": f"{side[0]}_{joint}"
    for side in ("left", "right")
    for point, joint in [
        *((name, name) for name in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")),
        ("foot_index", "toe_tip"),
        ("index", "hand"),
    ]
}


@dataclass(frozen=True, eq=False)
class Errors:
    """A network's errors on one sequence.

    offset: (K, 3) m, forward, left, up of the body. rest: (V, F, K, 2) m across the line of sight.
    confidence: (V, F, K).
    """

    offset: np.ndarray
    rest: np.ndarray
    confidence: np.ndarray


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="simulate_keypoints.py", description=__doc__.splitlines()[0]
    )
    parser.add_argument("sequence", type=Path, metavar="SEQUENCE")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE")
    parser.add_argument("--like", nargs="+", type=Path, required=True, metavar="SEQUENCE")
    parser.add_argument("--seed", type=int, default=0)
    add_message_flags(parser)
    parser.set_defaults(run=_run)
    return run_command(parser)


def _run(args: argparse.Namespace) -> None:
    random = np.random.default_rng(args.seed)
    known = [measure_errors(folder) for folder in args.like]
    points, names, cameras = simulate(args.sequence, known, random)
    found = {"keypoints": points, "keypoint_names": names, "camera_names": cameras}
    with write_atomically(args.output) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **found)
    stdout.print(f"wrote {args.output}", soft_wrap=True)


def measure_errors(folder: Path) -> Errors:
    """Return the errors of a sequence's keypoints."""
    rig, keypoints = _true_rig(folder), Keypoints.open(folder, Sequence.open(folder))
    points = keypoints.points[:, :, [keypoints.names.index(name) for name in JOINTS]]
    straight = points.astype(np.float64)
    for camera, own in zip(rig, straight, strict=True):
        own[..., :2] = camera.undistort(own[..., :2])
    found = triangulate(rig, straight, TriangulationConfig()).points
    joints, frames = _true_joints(folder)
    offset = np.nanmedian(np.einsum("fij,fki->fkj", frames, found - joints), axis=0)
    marked = joints + np.einsum("fij,kj->fki", frames, offset)
    rest = np.empty((*points.shape[:-1], 2))
    for camera, own, seen in zip(rig, rest, points, strict=True):
        pixels, depth = camera.project(marked)
        own[:] = (seen[..., :2] - pixels) * (depth / camera.K[0, 0])[..., None]
    return Errors(offset, rest, points[..., 2])


def simulate(
    folder: Path, known: list[Errors], random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return keypoints (V, F, K, 3), and the names of points (K,) and cameras (V,)."""
    rig, offset = _true_rig(folder), known[random.integers(len(known))].offset
    played = [of for each in known for of in zip(each.rest, each.confidence, strict=True)]
    chosen = random.permutation(len(played))
    views = []
    for view, camera in enumerate(rig):
        joints, frames = _true_joints(folder, view)
        rest, confidence = played[chosen[view % len(chosen)]]
        turn = (np.arange(len(joints)) + random.integers(len(rest))) % (2 * len(rest) - 2)
        turn = np.where(turn < len(rest), turn, 2 * len(rest) - 2 - turn)  # to and fro
        pixels, depth = camera.project(joints + np.einsum("fij,kj->fki", frames, offset))
        pixels += rest[turn] / (depth / camera.K[0, 0])[..., None]
        views.append(np.concatenate([pixels, confidence[turn][..., None]], -1))
    return np.stack(views).astype(np.float32), np.array(list(JOINTS)), np.array(rig.names)


def _true_rig(folder: Path) -> CameraRig:
    exact = folder / "truth_calibration.toml"
    return Sequence.open(folder, calibration=exact if exact.exists() else None).rig


def _true_joints(folder: Path, view: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return the true `JOINTS` (F, K, 3) m at a camera's times, and the body's frames (F, 3, 3),
    whose columns point forward, left and up along the trunk."""
    with np.load(folder / "truth.npz") as truth:
        names = list(truth["joint_names"])
        at_camera = "joints_at_cameras" in truth
        joints = truth["joints_at_cameras"][view] if at_camera else truth["joints"]

    def place(name: str) -> np.ndarray:
        return np.asarray(joints[:, names.index(name)], np.float64)

    up = place("neck") - place("pelvis")
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    left = place("l_hip") - place("r_hip")
    left -= (left * up).sum(-1, keepdims=True) * up
    left /= np.linalg.norm(left, axis=-1, keepdims=True)
    return np.stack([place(name) for name in JOINTS.values()], 1), np.stack(
        [np.cross(left, up), left, up], -1
    )


if __name__ == "__main__":
    sys.exit(main())
