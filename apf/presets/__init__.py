"""Presets: a paper's whole system under its name, a TOML file each, in the form of --config."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from apf.filters.method import Method
from psfs.common.config import Config, part, setting
from psfs.common.requests import find_presets, read_preset
from psfs.presets import PRESETS as OF_RECONSTRUCTION
from psfs.voxels.config import ReconstructionConfig

#: Their files by name; one of the reconstruction's name begins with that.
PRESETS = find_presets(Path(__file__).parent, OF_RECONSTRUCTION)


class Preset(Config):
    """The settings of `apf track --preset name`; without a name, its defaults."""

    name: str = setting("", "Name of the preset.")
    method: Method = part(Method)
    reconstruction: ReconstructionConfig = part(ReconstructionConfig)
    body: str | None = setting(None, "Name of the body, as of --body.", "the command's")
    background: str | None = setting(
        None, "How silhouettes are made, as of --background.", "the sequence's"
    )
    all_cameras: bool = setting(False, "Whether cameras are kept that disagree with the others.")


def preset(name: str, **choice: Any) -> Preset:
    """Return the settings of a preset, with another `search` or `objective` if one is stated.
    Raises InputError for an unknown name."""
    values = read_preset(PRESETS, name)
    return Preset(
        name=name,
        method=Method.from_dict({**values["method"], **choice}, "method"),
        reconstruction=ReconstructionConfig.from_dict(
            values.get("reconstruction", {}), "reconstruction"
        ),
        body=values.get("body"),
        background=values.get("background"),
        all_cameras=values.get("all-cameras", False),
    )
