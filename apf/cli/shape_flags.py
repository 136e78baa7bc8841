"""Flags for the body's shape in images: trapezoids, frusta, or a mesh of the person."""

from __future__ import annotations

import argparse
from typing import Any

from pydantic.fields import FieldInfo

from apf.image_objective.config import ObjectiveConfig
from cl import InputError
from psfs.cli.commandline import path_or_name
from psfs.cli.setting_flags import Names, add_setting_flags
from psfs.common.config import field_choices

#: The settings with a flag of their own here, besides --shape.
OF_SHAPES = ("mesh_weights", "mesh_pose", "round_ends")
_PARSERS = {"mesh_weights": path_or_name, "mesh_pose": path_or_name}


def add_shape_flags(parser: argparse.ArgumentParser) -> None:
    """Add --shape, --shape-weights, --shape-pose and --round-ends."""
    group = parser.add_argument_group("shape", "how the body looks in pictures")
    _, *frusta = field_choices(ObjectiveConfig.model_fields["vertices_per_part"])
    known = ", ".join(map(str, frusta))
    group.add_argument(
        "--shape",
        type=path_or_name,
        metavar="N|FILE",
        help="vertices per part: 4 for trapezoids, 8 for square frusta, more for elliptic ones "
        f"({known}); or a mesh of the person, metres, that trimesh reads, made for the body of "
        "--body (default: 4)",
    )
    add_setting_flags(group, ObjectiveConfig, _default, only=OF_SHAPES, parsers=_PARSERS)


def _default(path: Names, field: FieldInfo) -> str:
    usual = {"mesh_weights": "the nearest cone's", "mesh_pose": "the body's rest"}
    return usual.get(path[-1], "off")


def shape_settings(args: argparse.Namespace) -> dict[str, Any]:
    """Return the settings of an ObjectiveConfig that --shape sets. Raises InputError if another
    flag applies only to a mesh and --shape names none."""
    if args.shape is not None and not args.shape.isdigit():
        return {"mesh_file": args.shape}
    for name, flag in (("mesh_weights", "--shape-weights"), ("mesh_pose", "--shape-pose")):
        if getattr(args, name) is not None:
            raise InputError(f"{flag} applies only to a mesh; expected --shape FILE with it")
    if args.shape is None:
        return {}
    return {"vertices_per_part": int(args.shape), "mesh_file": ""}
