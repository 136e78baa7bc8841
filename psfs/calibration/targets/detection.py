"""Looking for the target in all pictures."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Protocol

import numpy as np

from cl import InputError
from psfs.calibration.targets.boards import Found, grey_of
from psfs.calibration.targets.target import Sighting, Target
from psfs.cameras.camera import CameraRig
from psfs.footage.layouts.uncalibrated import LAYOUT, read_uncalibrated
from psfs.footage.settings import Settings
from psfs.sequence import Frame
from psfs.sequence import Sequence as Views

#: Pictures of a camera whose median is the scene behind a wand.
_OF_SCENE = 15
#: Pictures in which another board is looked for, where the stated one is in none.
_HINTS = 12


class Finder(Protocol):
    """Finds a target in a picture (h, w, 3) uint8 BGR of a view: ids (N,) and pixels (N, 2)."""

    target: Target

    def __call__(self, view: int, picture: np.ndarray) -> Found | None: ...


def open_uncalibrated(folder: Path, stated: Settings) -> Views:
    """Return the views of a folder that needs no calibration; `sequence.toml` counts. Raises
    InputError for what cannot be read."""
    settings = stated.over(Settings.read(folder / "sequence.toml"))
    if settings.sync == "auto":
        raise InputError("sync is auto, which needs a calibration; expected CAMERA=N,...")
    return Views(folder, LAYOUT, read_uncalibrated(folder, settings), settings)


def pictures_of(frame: Frame, rig: CameraRig) -> list[np.ndarray]:
    """Return the pictures of a frame in their own sizes."""
    assert frame.images is not None
    pairs = zip(frame.images, rig, strict=True)
    return [image[: camera.size[1], : camera.size[0]] for image, camera in pairs]


def sightings_in(views: Views, chosen: Sequence[int], finder: Finder) -> Iterator[list[Sighting]]:
    """Yield the sightings of every chosen frame, all views looked at together. Raises InputError
    for a picture that cannot be read."""
    rig = views.rig
    workers = min(len(rig), os.cpu_count() or 1)
    with views.reader() as read, ThreadPoolExecutor(workers) as pool:
        for index in chosen:
            found = pool.map(finder, range(len(rig)), pictures_of(read(index), rig))
            yield [
                Sighting(index, view, *seen) for view, seen in enumerate(found) if seen is not None
            ]


def empty_scenes(views: Views, chosen: Sequence[int]) -> list[np.ndarray]:
    """Return the grey pictures (h, w) uint8 of every view without what moves: medians over time of
    some of the chosen frames."""
    picked = np.unique(np.linspace(0, len(chosen) - 1, _OF_SCENE).round().astype(int))
    stacks: list[list[np.ndarray]] = [[] for _ in views.rig]
    with views.reader() as read:
        for row in picked:
            for stack, picture in zip(
                stacks, pictures_of(read(chosen[row]), views.rig), strict=True
            ):
                stack.append(grey_of(picture))
    return [np.median(stack, axis=0).astype(np.uint8) for stack in stacks]


def what_is_seen(
    views: Views, chosen: Sequence[int], look: Callable[[np.ndarray], str | None]
) -> str | None:
    """Return what some of the pictures show by `look`, the `hint` of a finder whose board is in
    none; None for nothing."""
    picked = np.unique(np.linspace(0, len(chosen) - 1, _HINTS).round().astype(int))
    seen: dict[str, int] = {}
    with views.reader() as read:
        for row in picked:
            for picture in pictures_of(read(chosen[row]), views.rig):
                hint = look(picture)
                if hint is not None:
                    seen[hint] = seen.get(hint, 0) + 1
    return max(seen, key=lambda hint: seen[hint]) if seen else None
