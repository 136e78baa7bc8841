"""Flags that choose a method, for every command that tracks."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from dataclasses import fields, replace
from typing import Any

from apf.cli.shape_flags import SHAPE_FLAGS, add_shape_flags, shape_settings
from apf.filters.config import TERMS, USUAL_TERMS, FilterConfig, likelihood_weights
from apf.filters.method import Method
from apf.filters.objectives import OBJECTIVES
from apf.filters.searches import SEARCHES
from apf.filters.searches.sir import SirConfig
from apf.filters.searches.swarm import SwarmConfig
from apf.image_objective.config import (
    EDGE_KINDS,
    PROXIMITIES,
    RENDERERS,
    FeatureConfig,
    ObjectiveConfig,
    ProximityConfig,
)
from cl import InputError
from psfs.cli.settings import add_configs, refuse_unused

#: Settings of the search that have a flag of their own.
_SETTINGS = {
    "n_particles": ("--particles", "particles"),
    "n_layers": ("--layers", "annealing layers, or the swarm's iterations"),
    "seed": ("--seed", "seed of the noise; the same seed gives the same track"),
    "noise": ("--noise", "scale of the noise"),
    "spread": ("--spread", "bound of the noise, times the set's own deviation; 0 for none"),
    "trunk_layers": ("--trunk-layers", "apf: first layers that move the trunk alone"),
    "surface_weight": ("--surface-weight", "weight of surface voxels left unexplained"),
    "overlap_weight": ("--overlap-weight", "weight of parts lying in each other"),
}
#: Weights that the voxels' likelihood and the image objectives have both.
_WEIGHTS = {
    "edge_weight": ("--edge-weight", "weight of the edges, Song et al. eq. (14); or w2, Rymut"),
    "silhouette_weight": ("--silhouette-weight", "of the silhouettes, eq. (15); or w1, Rymut"),
}
#: Settings of the other parts of a method, by its field; proximity is part of the features.
_PARTS: dict[str, tuple[type, dict[str, tuple[str, str]]]] = {
    "swarm": (
        SwarmConfig,
        {
            "inertia": ("--inertia", "pso: share of its velocity that a particle keeps"),
            "cognitive": ("--cognitive", "pso: pull of a particle's own best"),
            "social": ("--social", "pso: pull of the best of all"),
        },
    ),
    "sir": (
        SirConfig,
        {"sigma_z": ("--sigma-z", "sir: of Rymut eq. (2.42), 0 for one found in each frame")},
    ),
    "image": (
        ObjectiveConfig,
        {"renderer": ("--renderer", f"image objectives: {', '.join(RENDERERS)}")},
    ),
    "features": (
        FeatureConfig,
        {
            "edges": ("--edges", f"image objectives: {', '.join(EDGE_KINDS)}"),
        },
    ),
    "proximity": (
        ProximityConfig,
        {
            "function": ("--proximity", f"image objectives: {', '.join(PROXIMITIES)}"),
            "farthest": ("--edge-reach", "image objectives: px of 640 at which it is 0"),
        },
    ),
}

#: Flags that one method alone has a use for.
_OWNERS = {
    ("trunk_layers",): "apf",
    ("inertia", "cognitive", "social"): "pso",
    ("sigma_z",): "sir",
    ("low_pass", "max_error", "longest_gap"): "triangulate",
}

#: Flags that image objectives alone, the voxels' likelihood alone, and both have a use for.
_OF_IMAGES = (
    *(name for part in ("image", "features", "proximity") for name in _PARTS[part][1]),
    *SHAPE_FLAGS,
)
_OF_VOXELS = ("likelihood", "surface_weight")
_OF_PICTURES = (*_WEIGHTS, "voxel_size", "all_cameras")

#: Flags of which a table [method] says all.
METHOD_FLAGS = (
    *("method", "objective", "likelihood", "one_way", *_SETTINGS, *_WEIGHTS),
    *(name for _, flags in _PARTS.values() for name in flags),
    *SHAPE_FLAGS,
)


def add_method_flags(
    parser: argparse.ArgumentParser, method: str = "apf", objective: str = "voxel", more: str = ""
) -> None:
    """--method and --objective with their defaults, and the flags of their settings. more: what
    the command knows beside the searches, for --help."""
    add_configs(parser, method=Method.from_dict)
    group = parser.add_argument_group("search", "what is searched with, and by what it is judged")
    group.add_argument(
        "--method",
        default=method,
        help="; ".join(f"{search.name}: {search.meaning}" for search in SEARCHES.values())
        + f"{more} (default: {method})",
    )
    group.add_argument(
        "--objective",
        default=objective,
        help=f"{', '.join(OBJECTIVES)}: the voxels' likelihood, or functions of image features, "
        f"which need no reconstruction (default: {objective})",
    )
    group.add_argument(
        "--likelihood",
        metavar="A,B=W",
        help=f"terms of the voxels' likelihood out of {', '.join(TERMS)}, each with its weight if "
        "it is not the usual one; Song et al.'s is edge=1,silhouette; contour and part_colour need "
        f"pictures (default: {','.join(USUAL_TERMS)}, and silhouette_recall where limbs are "
        "searched for)",
    )
    rows = [(FilterConfig().settings, {**_SETTINGS, **_WEIGHTS})]
    rows += [
        ({of.name: of.default for of in fields(part)}, flags) for part, flags in _PARTS.values()
    ]
    for defaults, flags in rows:
        for name, (flag, what) in flags.items():
            group.add_argument(
                flag,
                dest=name,
                type=type(defaults[name]),
                help=f"{what} (default: {_default(name, defaults[name])})",
            )
    add_shape_flags(parser)


def _default(name: str, value: object) -> str:
    """A default as --help shows it: where methods differ, with theirs."""
    others = [
        f"{search.defaults[name]} with {search.name}"
        for search in SEARCHES.values()
        if name in search.defaults
    ]
    if name in _WEIGHTS:
        others.append(f"{getattr(ObjectiveConfig(), name)} with image features")
    return ", ".join([str(value), *others])


def chosen_method(args: argparse.Namespace) -> Method:
    """What the flags of `add_method_flags` and --config choose. Raises InputError."""

    def given(names: Iterable[str]) -> dict[str, Any]:
        return {name: getattr(args, name) for name in names if getattr(args, name) is not None}

    base = _base(args)
    images = base.uses_images
    _refuse_others(args, base)
    shape = shape_settings(args)
    terms = _terms(args.likelihood) if args.likelihood is not None else {}
    settings = terms | given(_SETTINGS) | ({} if images else given(_WEIGHTS))
    method = replace(base, filter=base.filter.changed(**settings))
    looks = given({**_WEIGHTS, **_PARTS["image"][1]}) | shape
    image = replace(method.image, **looks) if images else method.image
    proximity = replace(method.features.proximity, **given(_PARTS["proximity"][1]))
    features = replace(method.features, proximity=proximity, **given(_PARTS["features"][1]))
    swarm = replace(method.swarm, **given(_PARTS["swarm"][1]))
    sir = replace(method.sir, **given(_PARTS["sir"][1]))
    both_ways = method.both_ways and not getattr(args, "one_way", False)
    return replace(
        method, both_ways=both_ways, image=image, features=features, swarm=swarm, sir=sir
    )


def _refuse_others(args: argparse.Namespace, base: Method) -> None:
    """Raise InputError for a flag that the method has no use for."""
    for flags, owner in _OWNERS.items():
        if base.search != owner:
            refuse_unused(args, flags, f"is of --method {owner}; this one is {base.search}")
    none = f"expected none with --objective {base.objective}"
    if not base.uses_images:
        refuse_unused(args, _OF_IMAGES, f"is the image objectives'; {none}")
    if not base.uses_voxels:
        refuse_unused(args, _OF_VOXELS, f"is the voxels'; {none}")
    if base.objective == "keypoints":
        refuse_unused(args, _OF_PICTURES, f"is of pictures; {none}")


def _terms(text: str) -> dict[str, float]:
    """The weights of --likelihood. Raises InputError where it names a term twice, or no term has a
    weight."""
    terms = likelihood_weights(text)
    names = [part.partition("=")[0].strip() for part in text.split(",")]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice:
        raise InputError(f"--likelihood {text}: {twice} is there twice; expected each term once")
    if not any(terms.values()):
        raise InputError(f"--likelihood {text}: no term has a weight; expected one at least")
    return terms


def _base(args: argparse.Namespace) -> Method:
    """The method whose settings the flags change: that of --config, unless a flag states another
    one, else the chosen one's defaults."""
    base: Method | None = args.configs.get("method")
    if base is None:
        return Method.of(args.method, args.objective)
    stated = args.stated_settings
    objective = stated.get("objective", base.objective)
    if stated.get("method", base.search) == base.search:
        return replace(base, objective=objective)
    if args.config is None:  # a preset, which says no more than it means
        own = {"search": args.method, "objective": objective}
        return Method.from_dict({**args.preset_tables["method"], **own}, "method")
    return Method.of(args.method, objective)
