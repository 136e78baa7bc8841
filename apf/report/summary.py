"""The `summary.json` of a track: how it was made, its quality, its files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from apf.body.kinematics import posed_joints
from apf.body.model import BodyModel, sideless
from apf.body.stature import stature
from apf.body.surface import Surface
from apf.tracking.track import Track
from cl import InputError
from psfs.common.files import name_file_in_errors, read_json
from psfs.common.schema import Table, parse_values
from psfs.output.reconstruction_folder import GridFacts, SequenceFacts
from psfs.voxels.config import ReconstructionConfig
from psfs.voxels.grid import VoxelGrid

SUMMARY = "summary.json"


def body_facts(body: BodyModel, surface: Surface | None = None) -> dict[str, Any]:
    """Return the body's name, the person's height and the lengths between connected joints, m; of a
    measured person also the standard deviations of these, volume and girths, see `Surface.measure`.

    The height is None if only a part of the person is modelled. Left and right, which are equal,
    are listed once.
    """
    joints = posed_joints(body, body.rest_pose[None])[0]
    lengths = {}
    deviations = {}
    for number, (a, b) in enumerate(body.edges):
        first, second = (sideless(body.joint_names[i]).replace("_", " ") for i in (a, b))
        lengths[f"{first} to {second}"] = round(float(np.linalg.norm(joints[a] - joints[b])), 3)
        if surface is not None:
            deviations[f"{first} to {second}"] = round(float(surface.lengths[number]), 3)
    try:
        height: float | None = round(stature(body), 3)
    except InputError:
        height = None
    facts = {"name": body.name, "height_m": height, "lengths_m": lengths}
    if surface is not None:
        facts |= {"lengths_deviation_m": deviations, **surface.measure(body)}
    return facts


class _Summary(Table):
    """The entries of a summary that are read."""

    sequence: SequenceFacts
    config: dict[str, Any]
    warnings: list[str]
    complete: bool = True


def read_summary(folder: Path) -> dict[str, Any]:
    """Read the summary that `apf track` wrote into `folder`. Raises InputError, or
    MissingFileError."""
    path, what = folder / SUMMARY, "the summary of an `apf track`"
    summary: dict[str, Any] = read_json(path, what)
    parse_values(_Summary, summary, f"{path}: not {what}")
    return summary


def read_tracked_config(folder: Path, summary: Mapping[str, Any]) -> ReconstructionConfig:
    """Return the reconstruction settings of the track. Raises InputError."""
    try:
        return ReconstructionConfig.from_dict(summary["config"])
    except InputError as error:
        raise InputError(f"{folder / SUMMARY}: {error}; run apf track again") from None


def read_tracked_grid(track: Track) -> VoxelGrid | None:
    """Return the grid of the voxels that a track was estimated from; None without voxels.

    Raises InputError.
    """
    stated = json.loads(track.provenance).get("grid")
    if stated is None:
        return None
    with name_file_in_errors("the track's grid"):
        return parse_values(GridFacts, stated).grid
