"""Trackers of bodies that differ in size alone."""

from __future__ import annotations

from dataclasses import replace

from apf.backend import make_filter
from apf.body.model import BodyModel
from apf.filters.base import DeviceTracker, Tracker
from apf.filters.config import FilterConfig
from apf.scene import Scene


class Trackers:
    """`trackers(body, config)`: returns a tracker with these settings for a body of the template's
    structure.

    A start tries about fifty bodies, and making a tracker takes as long as several of its steps. So
    there is one tracker for each set of settings, and it is given the next body. A tracker is valid
    until the next call with the same settings; call its `start` first.
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
        tracker = make_filter(replace(self._scene, body=body), config)
        if isinstance(tracker, DeviceTracker):  # making a NumPy twin takes no time
            self._kept[config] = tracker
        return tracker
