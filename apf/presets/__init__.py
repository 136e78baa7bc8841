"""Presets: a paper's whole system under its name, a TOML file each, in the form of --config."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from apf.filters.method import Method
from psfs.common.presets import presets_in, read_preset
from psfs.presets import PRESETS as OF_RECONSTRUCTION
from psfs.reconstructor import ReconstructionConfig

#: Their files by name; one of the reconstruction's name begins with that.
PRESETS = presets_in(Path(__file__).parent, OF_RECONSTRUCTION)


@dataclass(frozen=True)
class Preset:
    """body, background: names, as of `apf track`'s flags; None for its defaults. all_cameras: keep
    those that disagree with the others."""

    name: str
    method: Method
    reconstruction: ReconstructionConfig
    body: str | None = None
    background: str | None = None
    all_cameras: bool = False


def preset(name: str) -> Preset:
    """Return the settings of a preset. Raises InputError for an unknown name."""
    values = read_preset(PRESETS, name)
    return Preset(
        name,
        Method.from_dict(values["method"], "method"),
        ReconstructionConfig.from_dict(values.get("reconstruction", {}), "reconstruction"),
        body=values.get("body"),
        background=values.get("background"),
        all_cameras=values.get("all-cameras", False),
    )
