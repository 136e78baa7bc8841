"""One person of a take that is tracked, and the takes of a request."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from apf.keypoints.keypoints import Keypoints
from apf.request import TrackingRequest
from apf.tracking.progress import StageProgress
from apf.tracking.recovery import with_seeds
from cl import Device, InputError, NumpyDevice
from psfs.common.files import resolve_path
from psfs.common.ranges import check_number


@dataclass(frozen=True)
class TrackJob:
    """One person of a take that is tracked.

    request: of the take; its `output` is the person's folder, or None if nothing is written.
    remarks: warnings about the footage. of_people: which person of how many, for the summary;
    empty for the only one. seen: frames (F,) that show the person, None for all. keypoints: of the
    person, with doubts about them. why_one: why one person is tracked even if several are seen.
    """

    request: TrackingRequest
    device: Device | NumpyDevice
    progress: StageProgress
    remarks: tuple[str, ...] = ()
    of_people: Mapping[str, int] = field(default_factory=dict)
    seen: np.ndarray | None = None
    keypoints: Keypoints | None = None
    doubts: tuple[str, ...] = ()
    why_one: str = ""

    def title(self, take: str) -> str:
        """Return the title of the pages of a take: its name, and which person of several."""
        if not self.of_people:
            return take
        return f"{take}, person {self.of_people['person']} of {self.of_people['people']}"

    @property
    def folders(self) -> list[Path]:
        """The folder of each seed's files; none if nothing is written."""
        out = self.request.output
        return [] if out is None else seed_folders(self.request, out)


def list_inputs(request: TrackingRequest) -> list[Path]:
    """Return the files and folders that are read, as far as a request names them."""
    stated = [Path(p) for p in (request.init, request.body) if isinstance(p, (str, Path))]
    return [request.folder, *(path for path in stated if path.exists())]


def list_seeds(request: TrackingRequest) -> list[int]:
    """Return the seeds of the runs. Raises InputError."""
    n_runs = 1 if request.seeds is None else request.seeds
    check_number("--seeds", n_runs, 1, 1000)
    first = request.method.filter.search.seed
    seeds = list(range(first, first + n_runs))
    with_seeds(request.method, seeds[-1:])
    return seeds


def seed_folders(request: TrackingRequest, output: Path) -> list[Path]:
    """Return the folder of each seed's files in that of a person."""
    if request.seeds is None:
        return [output]
    return [output / f"seed{seed}" for seed in list_seeds(request)]


def take_names(folders: tuple[Path, ...]) -> list[str]:
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
