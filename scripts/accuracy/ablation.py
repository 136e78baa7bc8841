"""Ablations: the defaults without one of their parts, as settings by name, like presets."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from apf.filters.method import Method
from apf.presets import Preset, preset


def _filter(settings: Preset, **changes: Any) -> Preset:
    changed = settings.method.filter.with_changes(**changes)
    return settings.replace(method=settings.method.replace(filter=changed))


def _method(settings: Preset, **changes: Any) -> Preset:
    return settings.replace(method=settings.method.replace(**changes))


def _silhouettes(settings: Preset, part: str, **changes: Any) -> Preset:
    changed = settings.reconstruction.overlay({"silhouette": {part: changes}})
    return settings.replace(reconstruction=changed)


#: The parts that are left out, and the change that removes each.
ABLATIONS: dict[str, Callable[[Preset], Preset]] = {
    "no edges": partial(_filter, edge_weight=0.0),
    "no silhouettes": partial(_filter, silhouette_weight=0.0),
    "no surface": partial(_filter, surface_weight=0.0),
    "no contours": partial(_filter, contour_weight=0.0),
    "no colours of parts": partial(_filter, part_colour_weight=0.0),
    "no overlap": partial(_filter, overlap_weight=0.0),
    "no posture prior": partial(_filter, posture_prior_weight=0.0),
    "no velocity": partial(_filter, velocity=0.0),
    "no trunk first": partial(_filter, trunk_layers=0),
    "no refinement, no limb search": partial(_filter, refinement_steps=0),
    "no limb search": partial(_filter, limb_search_reach=0.0),
    "no silhouette recall": partial(_filter, limb_search_least_recall=0.0),
    "no way back": partial(_method, both_ways=False),
    "no recovery": partial(_method, recover=False),
    "no holes filled": partial(_filter, foreground_join=False),
    "no floor's shadows": partial(_silhouettes, part="floor", on=False),
    "no rim": partial(_silhouettes, part="rim", on=False),
    "no smoothing": partial(_silhouettes, part="smoothing", reach=0),
    "no learning": partial(_silhouettes, part="appearance", learn=False),
    "50 particles x 5 layers": partial(_filter, n_particles=50, n_layers=5),
}


def _impulse(settings: Preset) -> Preset:
    features = settings.method.features
    proximity = features.proximity.replace(function="impulse")
    return _method(settings, features=features.replace(proximity=proximity))


def _plain(settings: Preset) -> Preset:
    """Use a mixture without detection of shadows, of which no paper speaks."""
    return settings.replace(background="mog-plain")


#: Other readings of a paper: the preset, and what is changed in it (docs/tracking.md).
READINGS: dict[str, tuple[str, Callable[[Preset], Preset]]] = {
    "rymut-impulse": ("rymut", _impulse),
    "rymut-plain": ("rymut", _plain),
    "kwolek-plain": ("kwolek", _plain),
}


def load_preset(name: str, **choice: Any) -> Preset:
    """Return the defaults without a part, by its name in `ABLATIONS`, or another reading of a
    paper, by its name in `READINGS`, or a preset; with another `search` or `objective` if one is
    stated. Raises InputError for an unknown name."""
    if name in READINGS:
        base, change = READINGS[name]
        return change(preset(base, **choice)).replace(name=name)
    if name not in ABLATIONS:
        return preset(name, **choice)
    return ABLATIONS[name](Preset(name=name, method=Method.create(**choice)))
