"""Trackers of bodies that differ in size alone."""

from __future__ import annotations

from dataclasses import replace

from apf.backend import filter_for
from apf.body.model import BodyModel
from apf.filters.base import DeviceTracker, Tracker
from apf.filters.config import FilterConfig
from apf.scene import Scene


class Trackers:
    """`trackers(body, config)`: what tracks a body of the template's structure with these settings.

    A start tries some fifty bodies. To make a tracker takes as long as several of its steps; so
    there is one for each set of settings, which gets the next body. It is the caller's until the
    next call with the same settings; `start` it first.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._kept: dict[FilterConfig, DeviceTracker] = {}

    def __call__(self, body: BodyModel, config: FilterConfig) -> Tracker:
        """Return the tracker of `body` with the settings `config`."""
        kept = self._kept.get(config)
        if kept is not None:
            if kept.body is not body:
                kept.change_body(body)
            return kept
        tracker = filter_for(replace(self._scene, body=body), config)
        if isinstance(tracker, DeviceTracker):  # a twin is made in no time
            self._kept[config] = tracker
        return tracker
