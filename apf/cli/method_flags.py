"""Flags that choose a method, for every command that tracks."""

from __future__ import annotations

import argparse

from pydantic.fields import FieldInfo

from apf.cli.shape_flags import OF_SHAPES, add_shape_flags, shape_settings
from apf.filters.method import Method
from apf.filters.objectives import OBJECTIVES
from apf.filters.searches import SEARCHES
from apf.filters.term_weights import TERMS, USUAL_TERMS, list_comparing_weights, parse_weights
from apf.image_objective.config import ObjectiveConfig
from apf.settings import Settings
from cl import InputError
from psfs.cli.setting_flags import add_setting_flags, find_flagged_settings, with_flags
from psfs.cli.settings import add_configs, refuse_unused

#: The destinations of the flags of single settings, by the path of the setting.
_FLAGS = {path: path[-1] for path, _ in find_flagged_settings(Method)}
#: Weights that both the voxels' likelihood and the image objectives have.
_WEIGHTS = ("edge_weight", "silhouette_weight")
#: Flags that apply to one method only.
_OWNERS = {
    ("trunk_layers",): "apf",
    tuple(flag for path, flag in _FLAGS.items() if path[0] == "swarm"): "pso",
    tuple(flag for path, flag in _FLAGS.items() if path[0] == "sir"): "sir",
    ("low_pass", "max_error", "longest_gap"): "triangulate",
}

#: Flags that apply only to image objectives, only to the voxels' likelihood, and to both.
_OF_IMAGES = (
    *(f for p, f in _FLAGS.items() if p[0] in ("image", "features") and f not in _WEIGHTS),
    "shape",
)
_OF_VOXELS = ("likelihood", "surface_weight")
_OF_PICTURES = (*_WEIGHTS, "voxel_size", "all_cameras")

#: Flags that a table [method] replaces.
METHOD_FLAGS = (
    *("method", "objective", "likelihood", "one_way"),
    *dict.fromkeys(_FLAGS.values()),
    "shape",
)


def add_method_flags(parser: argparse.ArgumentParser, more: str = "") -> None:
    """Add --method and --objective, and the flags of their settings. more: further methods of the
    command, for --help."""
    add_configs(parser, Settings, "method")
    group = parser.add_argument_group("search", "search and objective")
    group.add_argument(
        "--method",
        default="apf",
        help="; ".join(f"{search.name}: {search.meaning}" for search in SEARCHES.values())
        + f"{more} (default: apf)",
    )
    group.add_argument(
        "--objective",
        default="voxel",
        help=f"{', '.join(OBJECTIVES)}: the voxels' likelihood, or functions of image features, "
        "which need no reconstruction (default: voxel)",
    )
    group.add_argument(
        "--likelihood",
        metavar="A,B=W",
        help=f"terms of the voxels' likelihood out of {', '.join(TERMS)}, each with its weight if "
        "it is not the usual one; Song et al.'s is edge=1,silhouette; contour and part_colour need "
        f"pictures (default: {','.join(USUAL_TERMS)}, and silhouette_recall where limbs are "
        "searched for)",
    )
    add_setting_flags(group, Method, _default, without=OF_SHAPES)
    add_shape_flags(parser)


def _default(path: tuple[str, ...], field: FieldInfo) -> str:
    """Return a default as --help shows it: one value, or one per method if they differ."""
    name = path[-1]
    others = [f"{s.defaults[name]} with {s.name}" for s in SEARCHES.values() if name in s.defaults]
    if name in _WEIGHTS:
        others.append(f"{getattr(ObjectiveConfig(), name)} with image features")
    return ", ".join([str(field.default), *others])


def select_method(args: argparse.Namespace) -> Method:
    """Return the method that --config and the flags of `add_method_flags` select. Raises
    InputError."""
    method = _base(args)
    _refuse_others(args, method)
    shape = shape_settings(args)
    if args.likelihood is not None:
        method = method.replace(filter=method.filter.with_changes(**_terms(args.likelihood)))
    if shape:
        method = method.replace(image=method.image.replace(**shape))
    others = ("filter.likelihood",) if method.uses_images else ("image", "features")
    method = with_flags(method, args, without=others)
    return method.replace(both_ways=method.both_ways and not getattr(args, "one_way", False))


def _refuse_others(args: argparse.Namespace, base: Method) -> None:
    """Raise InputError for a flag that does not apply to the method."""
    for flags, owner in _OWNERS.items():
        if base.search != owner:
            refuse_unused(
                args, flags, f"applies only to --method {owner}; this one is {base.search}"
            )
    none = f"expected none with --objective {base.objective}"
    if not base.uses_images:
        refuse_unused(args, _OF_IMAGES, f"applies only to image objectives; {none}")
    if not base.uses_voxels:
        refuse_unused(args, _OF_VOXELS, f"applies only to the voxels; {none}")
    if base.objective == "keypoints":
        refuse_unused(args, _OF_PICTURES, f"applies only to pictures; {none}")


def _terms(text: str) -> dict[str, float]:
    """Parse the weights of --likelihood. Raises InputError if it names a term twice, or if no term
    that compares the body with observations has a weight."""
    terms = parse_weights(text)
    names = [part.partition("=")[0].strip() for part in text.split(",")]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice:
        raise InputError(f"--likelihood {text}: {twice} is there twice; expected each term once")
    if not any(terms.values()):
        raise InputError(f"--likelihood {text}: no term has a weight; expected one at least")
    if not any(terms[weight] for weight in list_comparing_weights()):
        raise InputError(
            f"--likelihood {text}: none of these terms compares the body with anything that is "
            f"seen; expected one of {', '.join(list_comparing_weights().values())}, too"
        )
    return terms


def _base(args: argparse.Namespace) -> Method:
    """Return the method whose settings the flags change: that of --config, unless a flag names
    another one, else the defaults of the selected one."""
    base: Method | None = args.configs.get("method")
    if base is None:
        return Method.create(args.method, args.objective)
    stated = args.stated_settings
    objective = stated.get("objective", base.objective)
    if stated.get("method", base.search) == base.search:
        return base.replace(objective=objective)
    if args.config is None:  # a preset changes only the settings that it names
        own = {"search": args.method, "objective": objective}
        return Method.from_dict({**args.preset_tables["method"], **own}, "method")
    return Method.create(args.method, objective)
