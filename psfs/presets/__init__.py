"""Presets of the reconstruction: settings that are exactly a paper's, a TOML file each."""

from __future__ import annotations

from pathlib import Path

from psfs.common.requests import find_presets, read_preset
from psfs.voxels.config import ReconstructionConfig

#: Their files by name.
PRESETS = find_presets(Path(__file__).parent)


def preset(name: str) -> ReconstructionConfig:
    """Return the settings of a preset. Raises InputError for an unknown name."""
    values = read_preset(PRESETS, name).get("reconstruction", {})
    return ReconstructionConfig.from_dict(values, "reconstruction")
