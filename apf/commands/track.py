"""`apf track`: a skeleton per frame."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from apf.body import BodyModel, load_body, save_body
from apf.bodytrack import is_bodytrack, read_body
from apf.config import TERMS, FilterConfig, likelihood_weights
from apf.evaluate import evaluate, load_truth
from apf.features import EDGE_KINDS, PROXIMITIES, FeatureConfig
from apf.initial import fit_to_joints, read_pose, write_pose
from apf.joint_names import match_joints
from apf.methods import OBJECTIVES, SEARCH_DEFAULTS, Method
from apf.objective import ObjectiveConfig
from apf.overlay import write_overlay
from apf.pipeline import seeded, track_seeds
from apf.sir import SirConfig
from apf.start import start_of
from apf.swarm import SwarmConfig
from apf.track import Track, spans
from apf.trc import CONVENTIONS
from cl import Device, NumpyDevice, UserError, select_device
from psfs.commandline import add_command, add_device_flag, progress_bar, stderr, stdout
from psfs.commands.sequence_flags import (
    add_all_cameras_flag,
    add_sequence_flags,
    open_trusted,
    selected_frames,
)
from psfs.grid import VoxelGrid
from psfs.sequence import Sequence
from psfs.volume import automatic_grid

#: A start whose rival, looking another way, fits nearly as well is told of.
_DOUBT = 1.1

#: Settings of the search that have a flag of their own.
_SETTINGS = {
    "n_particles": ("--particles", "particles"),
    "n_layers": ("--layers", "annealing layers, or the swarm's iterations"),
    "seed": ("--seed", "seed of the noise; the same seed gives the same track"),
    "noise": ("--noise", "scale of the noise"),
    "spread": ("--spread", "bound of the noise, times the set's own deviation; 0 for none"),
    "trunk_layers": ("--trunk-layers", "apf: first layers that move the trunk alone"),
    "surface_weight": ("--surface-weight", "weight of surface voxels left unexplained"),
    "overlap_weight": ("--overlap-weight", "weight of parts lying in each other"),
}
#: Weights that the voxels' likelihood and the image objectives have both.
_WEIGHTS = {
    "edge_weight": ("--edge-weight", "weight of the edges, Song et al. eq. (14); or w2, Rymut"),
    "silhouette_weight": ("--silhouette-weight", "of the silhouettes, eq. (15); or w1, Rymut"),
}
#: Settings of the other parts of a method, by its field.
_PARTS: dict[str, tuple[type, dict[str, tuple[str, str]]]] = {
    "swarm": (
        SwarmConfig,
        {
            "inertia": ("--inertia", "pso: share of its velocity that a particle keeps"),
            "cognitive": ("--cognitive", "pso: pull of a particle's own best"),
            "social": ("--social", "pso: pull of the best of all"),
        },
    ),
    "sir": (
        SirConfig,
        {"sigma_z": ("--sigma-z", "sir: of Rymut eq. (2.42), 0 for one found in each frame")},
    ),
    "features": (
        FeatureConfig,
        {
            "edges": ("--edges", f"image objectives: {', '.join(EDGE_KINDS)}"),
            "proximity": ("--proximity", f"image objectives: {', '.join(PROXIMITIES)}"),
            "farthest": ("--edge-reach", "image objectives: px of 640 at which it is 0"),
        },
    ),
}


def register(commands: argparse._SubParsersAction) -> None:
    parser = add_command(commands, "track", run, "Reconstruct and track a person, frame by frame.")
    add_sequence_flags(parser)
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT")
    parser.add_argument(
        "--body",
        metavar="B",
        help="body model: a TOML file or a shipped name (default: song31, or the sequence's own)",
    )
    parser.add_argument(
        "--init",
        type=Path,
        metavar="P",
        help="first pose: a text file with a value per degree of freedom (radians, metres), or "
        "joints (npz or TRC) to whose first frame body and pose are fitted "
        "(default: the sequence's own, where it has one; else found in the first voxels)",
    )
    parser.add_argument(
        "--height", type=float, metavar="M", help="stature of the person, m, if it is known"
    )
    parser.add_argument(
        "--convention", choices=CONVENTIONS, default="y-up", help="axes of a TRC given to --init"
    )
    parser.add_argument("--voxel-size", type=float, metavar="M", help="edge of a voxel, m")
    add_all_cameras_flag(parser)
    add_method_flags(parser)
    parser.add_argument(
        "--seeds",
        type=int,
        metavar="N",
        help="make N runs at once, with seeds from --seed on, into OUT/seed0 and so on, and say "
        "how far they differ",
    )
    parser.add_argument("--no-overlay", action="store_true", help="write no overlay.mp4")
    add_device_flag(parser)


def add_method_flags(
    parser: argparse.ArgumentParser, method: str = "apf", objective: str = "voxel"
) -> None:
    """--method and --objective with their defaults, and the flags of their settings."""
    parser.add_argument(
        "--method",
        default=method,
        help="apf: annealed particle filter; pso: particle swarm; sir: particle filter "
        f"(default: {method})",
    )
    parser.add_argument(
        "--objective",
        default=objective,
        help=f"{', '.join(OBJECTIVES)}: the voxels' likelihood, or functions of image features, "
        f"which need no reconstruction (default: {objective})",
    )
    parser.add_argument(
        "--likelihood",
        metavar="A,B=W",
        help=f"terms of the voxels' likelihood out of {', '.join(TERMS)}, each with its weight if "
        "it is not the usual one; Song et al.'s is edge,silhouette; colour needs pictures "
        f"(default: {','.join(TERMS[:4])})",
    )
    group = parser.add_argument_group("search")
    rows = [(FilterConfig, {**_SETTINGS, **_WEIGHTS}), *_PARTS.values()]
    for config, flags in rows:
        defaults = {field.name: field.default for field in fields(config)}
        for name, (flag, what) in flags.items():
            group.add_argument(
                flag,
                dest=name,
                type=type(defaults[name]),
                help=f"{what} (default: {_default(name, defaults[name])})",
            )


def _default(name: str, value: object) -> str:
    """A default as --help shows it: where methods differ, with theirs."""
    others = [f"{v[name]} with {search}" for search, v in SEARCH_DEFAULTS.items() if name in v]
    if name in _WEIGHTS:
        others.append(f"{getattr(ObjectiveConfig(), name)} with image features")
    return ", ".join([str(value), *others])


def chosen_method(args: argparse.Namespace) -> Method:
    """What the flags of `add_method_flags` choose. Raises UserError."""

    def given(names: Iterable[str]) -> dict[str, Any]:
        return {name: getattr(args, name) for name in names if getattr(args, name) is not None}

    images = args.objective != "voxel"
    if images and args.likelihood is not None:
        raise UserError(
            f"--likelihood is the voxels'; expected none with --objective {args.objective}"
        )
    terms = likelihood_weights(args.likelihood) if args.likelihood is not None else {}
    settings = terms | given(_SETTINGS) | ({} if images else given(_WEIGHTS))
    method = Method.of(args.method, args.objective, **settings)
    image = replace(method.image, **given(_WEIGHTS)) if images else method.image
    parts = {name: config(**given(flags)) for name, (config, flags) in _PARTS.items()}
    return replace(method, image=image, **parts)


def run(args: argparse.Namespace) -> None:
    method = chosen_method(args)
    seeds = chosen_seeds(args, method)
    if args.height is not None and not 0.5 <= args.height <= 2.5:
        raise UserError(f"--height is {args.height}; expected 0.5 to 2.5 metres")
    device = select_device(args.device)
    sequence, _ = open_trusted(args, device)
    frames = selected_frames(args, sequence)
    given = first_pose(sequence, frames[0], args.body, args.init, args.convention)
    selection = slice(frames.start, frames.stop, frames.step)
    grid = None
    if method.uses_voxels or given is None:
        grid = automatic_grid(sequence, selection, args.voxel_size, device=device)
    if given is None:
        assert grid is not None
        given = found_start(device, sequence, grid, selection, args)
    body, pose = given
    bar = progress_bar()
    task = bar.add_task("tracking", total=len(frames))

    def advance() -> None:
        bar.start()  # not before the first frame: an error must stay a single line
        bar.advance(task)

    try:
        tracks = track_seeds(
            device, sequence, grid, body, pose, method, seeds,
            selection=selection, progress=advance,
        )  # fmt: skip
    finally:
        if bar.live.is_started:  # stopping prints a line
            bar.stop()
    for seed, track in zip(seeds, tracks, strict=True):
        folder = args.output if args.seeds is None else args.output / f"seed{seed}"
        write_pose(folder / "start.txt", pose)
        write_track(folder, sequence, track, body, overlay=not args.no_overlay)
        tell_of(track, len(frames), folder)
    if len(tracks[0]) < len(frames):
        raise KeyboardInterrupt
    if len(tracks) > 1:
        tell_spread(sequence, tracks)


def chosen_seeds(args: argparse.Namespace, method: Method) -> list[int]:
    """The seeds of the runs to make. Raises UserError."""
    n_runs = 1 if args.seeds is None else args.seeds
    if n_runs < 1:
        raise UserError(f"--seeds is {n_runs}; expected at least 1")
    first = method.filter.seed
    seeds = list(range(first, first + n_runs))
    seeded(method, seeds[-1:])
    return seeds


def tell_of(track: Track, n_frames: int, folder: Path) -> None:
    """Print what became of `n_frames` that were to be tracked."""
    if len(track) < n_frames:
        stderr.print(f"{len(track)} of {n_frames} frames are in {folder}")
        return
    stdout.print(f"{len(track)} frames tracked: {folder}", soft_wrap=True)
    if track.lost.any():
        stdout.print(f"the person was lost in frames {spans(track.frames[track.lost].tolist())}")
    if len(track.restarts):
        stdout.print(f"found again by a new search in frames {spans(track.restarts.tolist())}")


def tell_spread(sequence: Sequence, tracks: list[Track]) -> None:
    """Print how far the runs differ and, where the sequence has its truth, how far they err."""
    joints = np.stack([track.joints for track in tracks])
    away = 1000 * np.linalg.norm(joints - joints.mean(0), axis=-1)
    stdout.print(f"{len(tracks)} runs: joints lie {away.mean():.1f} mm from the runs' mean")
    truth = sequence.folder / "truth.npz"
    if truth.exists():
        errors = [1000 * evaluate(track, load_truth(truth)).mean_error for track in tracks]
        spread = f"{np.mean(errors):.1f} ± {np.std(errors, ddof=1):.1f} mm"
        stdout.print(f"mean error: {spread}, {min(errors):.1f} to {max(errors):.1f}")


def first_pose(
    sequence: Sequence, frame: int, body_name: str | None, init: Path | None, convention: str
) -> tuple[BodyModel, np.ndarray] | None:
    """The body to track and its pose (D,) in the first `frame`, or None if there is none given.

    Raises UserError.
    """
    own = body_name is None and is_bodytrack(sequence.folder)
    body = read_body(sequence.folder) if own else load_body(body_name or "song31")
    if init is None:
        return (body, body.rest_pose) if own else None
    if init.suffix.lower() not in (".npz", ".trc"):
        return body, read_pose(init, body)
    truth = load_truth(init, convention)
    rows = np.flatnonzero(truth.frames == frame)
    if not rows.size:
        raise UserError(f"{init}: no joints for frame {frame}, the first to be tracked")
    joints = {
        name: truth.joints[rows[0], place]
        for name, place in match_joints(truth.joint_names).items()
    }
    body, pose, _ = fit_to_joints(body, joints)
    return body, pose


def found_start(
    device: Device | NumpyDevice,
    sequence: Sequence,
    grid: VoxelGrid,
    selection: slice,
    args: argparse.Namespace,
) -> tuple[BodyModel, np.ndarray]:
    """The body and its first pose (D,) found in the voxels; a body from a file keeps its shape."""
    own_shape = args.body is not None and Path(args.body).suffix == ".toml"
    template = load_body(args.body or "song31")
    found = start_of(
        device,
        sequence,
        grid,
        template,
        selection,
        height=args.height,
        keep_shape=own_shape,
        seed=args.seed or 0,
    )
    if found.rival < _DOUBT:
        stderr.print(
            "it is not sure which way the person looks: another fits the voxels nearly as well"
        )
    return found.body, found.pose


def write_track(
    folder: Path, sequence: Sequence, track: Track, body: BodyModel, overlay: bool = True
) -> None:
    """The files of `write_files`, and overlay.mp4, into `folder`."""
    write_files(folder, track, body)
    if overlay:
        with progress_bar() as bar:
            task = bar.add_task("overlay", total=len(track))
            write_overlay(folder / "overlay.mp4", sequence, track, body, lambda: bar.advance(task))


def write_files(folder: Path, track: Track, body: BodyModel) -> None:
    """track.npz, joints.trc, joints.csv and body.toml into `folder`."""
    track.save(folder / "track.npz")
    track.write_trc(folder / "joints.trc")
    track.write_csv(folder / "joints.csv")
    save_body(folder / "body.toml", body)
