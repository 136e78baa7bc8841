"""Chunks of a track on disk while the rest is tracked, in case the process is killed."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from apf.body import BodyModel, save_body
from apf.formats.pose import write_pose
from apf.tracking.track import PARTS, Track, part_name


class Keeper:
    """Writes the chunks of each seed's track into its folder; see `apf.tracking.take.Keep`."""

    def __init__(self, folders: Sequence[Path]) -> None:
        self._folders, self._begun = folders, False

    def __call__(self, body: BodyModel, pose: np.ndarray, parts: Sequence[Track]) -> list[Path]:
        written = []
        for folder, part in zip(self._folders, parts, strict=True):
            if not self._begun:
                write_pose(folder / "start.txt", pose, body)
                save_body(folder / "body.toml", body)
            written.append(part_name(folder, part))
            part.save(written[-1])
        self._begun = True
        return written


def remove_parts(folder: Path) -> None:
    """Remove the chunks after the whole track is written."""
    for part in folder.glob(PARTS):
        part.unlink()
    with suppress(OSError):  # the folder may not exist
        (folder / PARTS).parent.rmdir()
