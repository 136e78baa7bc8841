"""Folder layouts, one small module each; `find_layout(folder)` returns the one that a folder
has."""

from __future__ import annotations

from pathlib import Path

from cl import InputError
from psfs.common.files import check_folder
from psfs.footage.layouts.common import Footage, Layout
from psfs.footage.layouts.datasets import BODYTRACK, HUMANEVA, MIDDLEBURY, UTRECHT
from psfs.footage.layouts.flat import FLAT
from psfs.footage.layouts.native import NATIVE
from psfs.footage.settings import SequenceSettings

__all__ = ["LAYOUTS", "Footage", "Layout", "find_layout"]

#: The most specific first: flat accepts any pictures beside a calibration.
LAYOUTS = (NATIVE, BODYTRACK, UTRECHT, HUMANEVA, MIDDLEBURY, FLAT)


def find_layout(folder: Path, settings: SequenceSettings) -> Layout:
    """Find the layout of `folder`.

    Raises InputError if no layout matches, MissingFileError if there is no such folder.
    """
    check_folder(folder)
    for layout in LAYOUTS:
        if layout.matches(folder, settings):
            return layout
    raise InputError(
        f"{folder}: no sequence is recognised; expected a calibration beside videos/, "
        "images/<camera>/ or masks/<camera>/, or a bodytrack, Utrecht, HumanEva or Middlebury "
        "folder"
    )
