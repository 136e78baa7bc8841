"""Detect the target in all pictures."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from pathlib import Path
from typing import TypeAlias

import numpy as np

from cl import InputError
from psfs.calibration.targets.boards import CharucoFinder, ChessboardFinder, to_grey
from psfs.calibration.targets.markers import MarkerFinder
from psfs.calibration.targets.target import Sighting
from psfs.common.numbers import pick_evenly
from psfs.footage.layouts.uncalibrated import LAYOUT, read_uncalibrated
from psfs.footage.settings import SequenceSettings
from psfs.sequence import Sequence as Views

#: A detector of a target in the pictures of a take.
Finder: TypeAlias = ChessboardFinder | CharucoFinder | MarkerFinder


def open_uncalibrated(folder: Path, stated: SequenceSettings, silhouettes: bool = False) -> Views:
    """Open a folder of views that needs no calibration; its `sequence.toml` applies.

    silhouettes: whether to open the empty scene and masks, too. Raises InputError for what cannot
    be read.
    """
    settings = stated.fill_from(SequenceSettings.read(folder / "sequence.toml"))
    if settings.sync == "auto":
        raise InputError(
            "sync is auto, which needs a calibration; expected audio (by the sound of a clap) or "
            "CAMERA=N,...; see docs/from_phones.md"
        )
    return Views(folder, LAYOUT, read_uncalibrated(folder, settings, silhouettes), settings)


def find_sightings(
    views: Views, chosen: Sequence[int], finders: Sequence[Finder]
) -> Iterator[list[Sighting]]:
    """Yield the sightings of every chosen frame, searching all views at once.

    finders: of targets of one shape. Since these move apart, each counts as a moment of its own:
    frame t of N targets becomes the frames N t to N t + N - 1. Raises InputError for a picture that
    cannot be read.
    """
    rig = views.rig
    workers = min(len(rig), os.cpu_count() or 1)
    with views.reader() as read, ThreadPoolExecutor(workers) as pool:
        for index in chosen:
            pictures, here = rig.crop(read(index).images), []
            for number, finder in enumerate(finders, len(finders) * index):
                detections = pool.map(finder, range(len(rig)), pictures)
                here += [
                    Sighting(number, view, *seen)
                    for view, seen in enumerate(detections)
                    if seen is not None
                ]
            yield here


def median_pictures(views: Views, chosen: Sequence[int]) -> list[np.ndarray]:
    """Return the median over time of every view's grey pictures (h, w) uint8, without what
    moves."""
    stacks = zip(*(map(to_grey, pictures) for pictures in _read_some(views, chosen)), strict=True)
    return [np.median(stack, axis=0).astype(np.uint8) for stack in stacks]


def find_hint(
    views: Views, chosen: Sequence[int], look: Callable[[np.ndarray], str | None]
) -> str | None:
    """Return the most frequent hint of `look` over some of the pictures; None without any.

    look: `describe_other_board` of a finder whose board is in none of the pictures.
    """
    hints = Counter(map(look, chain.from_iterable(_read_some(views, chosen))))
    del hints[None]
    return max(hints, key=hints.__getitem__, default=None)


def _read_some(views: Views, chosen: Sequence[int]) -> Iterator[list[np.ndarray]]:
    """Yield every view's picture of some of the chosen frames."""
    with views.reader() as read:
        for row in pick_evenly(len(chosen)):
            yield views.rig.crop(read(chosen[row]).images)
