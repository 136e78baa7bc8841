"""Folder layouts, one small module each. `recognised(folder)` tells which one a folder has."""

from __future__ import annotations

from pathlib import Path

from cl import UserError
from psfs.layouts.bodytrack import BODYTRACK
from psfs.layouts.common import Footage, Layout
from psfs.layouts.flat import FLAT
from psfs.layouts.middlebury import MIDDLEBURY
from psfs.layouts.native import NATIVE
from psfs.layouts.utrecht import UTRECHT
from psfs.settings import Settings

__all__ = ["LAYOUTS", "Footage", "Layout", "recognised"]

#: The most specific first: flat takes whatever lies beside a calibration.
LAYOUTS = (NATIVE, BODYTRACK, UTRECHT, MIDDLEBURY, FLAT)


def recognised(folder: Path, settings: Settings) -> Layout:
    """The layout of `folder`. Raises UserError if it has none."""
    if not folder.is_dir():
        found = "a file" if folder.exists() else "no such folder"
        raise UserError(f"{folder}: {found}; expected a folder with calibrated views")
    for layout in LAYOUTS:
        if layout.matches(folder, settings):
            return layout
    raise UserError(
        f"{folder}: no sequence is recognised; expected a calibration beside videos/, "
        "images/<camera>/ or masks/<camera>/, or a bodytrack, Utrecht or Middlebury folder"
    )
