"""One take of `apf track`, as requested by the flags."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from apf.cli.first_pose import check_start
from apf.cli.method_flags import select_method
from apf.filters.method import Method
from apf.keypoints import Keypoints
from apf.tracking.trackers import with_seeds
from cl import Device, InputError, NumpyDevice
from psfs.common.files import resolve_path
from psfs.sequence import Sequence
from psfs.session import Session, SessionSettings
from psfs.voxels.config import ReconstructionConfig

#: Greatest number of runs for --seeds.
MOST_SEEDS = 1000


@dataclass(frozen=True)
class TrackJob:
    """One take of the command: its flags, with its own `folder` and `output`, and the settings that
    they set. of_people: which person of how many it tracks, for the summary; empty for the only
    one. seen: frames (F,) that show the person, None for all. keypoints: of one of several
    people."""

    args: argparse.Namespace
    method: Method
    seeds: list[int]
    device: Device | NumpyDevice
    of_people: Mapping[str, int] = field(default_factory=dict)
    seen: np.ndarray | None = None
    keypoints: Keypoints | None = None

    @classmethod
    def from_arguments(
        cls, args: argparse.Namespace, device: Device | NumpyDevice, **own: object
    ) -> TrackJob:
        """Return the job for these flags; `own` overrides them for this take. Raises InputError."""
        method = select_method(args)
        seeds = list_seeds(args, method)
        check_start(args)
        return cls(argparse.Namespace(**{**vars(args), **own}), method, seeds, device)

    def person(
        self, number: int, of: int, seen: np.ndarray, keypoints: Keypoints | None = None
    ) -> TrackJob:
        """Return the job of one person, counted from 1, with a folder in this one's; seen: frames
        (F,) that show the person. keypoints: the person's own."""
        own = {**vars(self.args), "output": self.args.output / f"person{number}"}
        own["opened_keypoints"] = keypoints
        facts = {"person": number, "people": of}
        args = argparse.Namespace(**own)
        return replace(self, args=args, of_people=facts, seen=seen, keypoints=keypoints)

    def title(self, take: str) -> str:
        """Return the title of the pages of a take: its name, and which person of several."""
        if not self.of_people:
            return take
        return f"{take}, person {self.of_people['person']} of {self.of_people['people']}"

    @property
    def folders(self) -> list[Path]:
        """The folder of each seed's files."""
        return seed_folders(self.args, self.seeds)

    @property
    def inputs(self) -> list[Path]:
        """The files and folders that are read, as far as the flags name them."""
        args = self.args
        stated = [Path(path) for path in (args.init, args.body) if path is not None]
        return [Path(args.folder), *(path for path in stated if path.exists())]


def reconstruction_config(args: argparse.Namespace) -> ReconstructionConfig:
    """Return the settings of the reconstruction of --config and --preset."""
    return args.configs.get("reconstruction") or ReconstructionConfig()


def open_session(
    args: argparse.Namespace, sequence: Sequence, device: Device | NumpyDevice
) -> Session:
    """Return the session of the frames, and with the settings, that the flags select."""
    frames = args.frames or slice(None)
    settings = SessionSettings(reconstruction_config(args), frames, args.voxel_size)
    return Session(sequence, device, settings)


def seed_folders(args: argparse.Namespace, seeds: list[int]) -> list[Path]:
    """Return the folder of each seed's files."""
    if args.seeds is None:
        return [args.output]
    return [args.output / f"seed{seed}" for seed in seeds]


def take_names(folders: list[Path]) -> list[str]:
    """Return a name for each of the takes: that of its folder, preceded by as many parent folders
    as are needed to distinguish the takes. Raises InputError if a folder is given twice."""
    paths = [resolve_path(folder) for folder in folders]
    for path in paths:
        if paths.count(path) > 1:
            raise InputError(f"{path} is given twice; expected different takes")
    depth, names = 1, [path.name for path in paths]
    while len(set(names)) < len(names):
        depth += 1
        names = ["_".join(path.parts[-depth:]) for path in paths]
    return names


def list_seeds(args: argparse.Namespace, method: Method) -> list[int]:
    """Return the seeds of the runs. Raises InputError."""
    n_runs = 1 if args.seeds is None else args.seeds
    if not 1 <= n_runs <= MOST_SEEDS:
        raise InputError(f"--seeds is {n_runs}; expected 1 to {MOST_SEEDS}")
    first = method.filter.search.seed
    seeds = list(range(first, first + n_runs))
    with_seeds(method, seeds[-1:])
    return seeds
