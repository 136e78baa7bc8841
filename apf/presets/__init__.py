"""Presets: a paper's whole system under its name, a TOML file each, in the form of --config."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from apf.filters.method import Method
from psfs.common.presets import presets_in, read_preset
from psfs.presets import PRESETS as OF_RECONSTRUCTION
from psfs.reconstructor import ReconstructionConfig

#: Their files by name; one of the reconstruction's name begins with that.
PRESETS = presets_in(Path(__file__).parent, OF_RECONSTRUCTION)


@dataclass(frozen=True)
class Preset:
    """The settings of `apf track --preset name`; without a name, its defaults.

    body, background: names, as of its flags; None for its defaults. all_cameras: keep those that
    disagree with the others.
    """

    name: str = ""
    method: Method = field(default_factory=Method)
    reconstruction: ReconstructionConfig = field(default_factory=ReconstructionConfig)
    body: str | None = None
    background: str | None = None
    all_cameras: bool = False


def preset(name: str, **choice: Any) -> Preset:
    """Return the settings of a preset, with another `search` or `objective` if one is stated.
    Raises InputError for an unknown name."""
    values = read_preset(PRESETS, name)
    return Preset(
        name,
        Method.from_dict({**values["method"], **choice}, "method"),
        ReconstructionConfig.from_dict(values.get("reconstruction", {}), "reconstruction"),
        body=values.get("body"),
        background=values.get("background"),
        all_cameras=values.get("all-cameras", False),
    )
