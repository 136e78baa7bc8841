"""Flags for the body's shape in images: trapezoids, frusta, or a mesh of the person."""

from __future__ import annotations

import argparse
from typing import Any

from apf.image_objective.config import ObjectiveConfig
from cl import InputError
from psfs.cli.commandline import path_or_name
from psfs.common.config import field_choices

#: The settings of `ObjectiveConfig` among these flags.
SHAPE_FLAGS = ("shape", "shape_weights", "shape_pose", "round_ends")


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
    group.add_argument(
        "--shape-weights",
        type=path_or_name,
        metavar="NPZ",
        help="how the bones move the mesh: weights, vertices x bones (default: the nearest cone's)",
    )
    group.add_argument(
        "--shape-pose",
        type=path_or_name,
        metavar="P",
        help="pose that the mesh shows, a text file (default: the body's rest)",
    )
    group.add_argument(
        "--round-ends",
        action="store_true",
        default=None,
        help="trapezoids with the cones' round ends",
    )


def shape_settings(args: argparse.Namespace) -> dict[str, Any]:
    """Return the settings of an ObjectiveConfig that the flags set. Raises InputError."""
    settings: dict[str, Any] = {}
    if args.shape is not None and args.shape.isdigit():
        settings |= {"vertices_per_part": int(args.shape), "mesh_file": ""}
    elif args.shape is not None:
        settings["mesh_file"] = args.shape
    for flag, name in (("shape_weights", "mesh_weights"), ("shape_pose", "mesh_pose")):
        if getattr(args, flag) is not None:
            settings[name] = getattr(args, flag)
            if not settings.get("mesh_file"):
                shown = flag.replace("_", "-")
                raise InputError(f"--{shown} is of a mesh; expected --shape FILE with it")
    if args.round_ends is not None:
        settings["round_ends"] = args.round_ends
    return settings
