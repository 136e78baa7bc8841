"""The searches that are registered, each with its settings.

Every module here registers one, and packages register others by the entry point psfs_apf.searches.
Trackers and twins are named, not imported: settings are read without OpenCL.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from psfs.common.registry import Registry


@dataclass(frozen=True)
class SearchSpec:
    """A search as it is registered: in `SEARCHES`, or by an entry point of a package.

    name: by which --method chooses it. meaning: of the name. tracker, twin: a `DeviceTracker` and a
    `NumpyTracker`, as "package.module:Class", which take scene, likelihood=, config= and, by their
    names, settings; they are imported when they are used. settings: classes of the search's own,
    each a part of `Method` by that name. defaults: that it changes in `FilterConfig`, by the names
    of `FilterConfig.create`. shares_launches: whether the tracker takes seeds= of several runs.
    """

    name: str
    meaning: str
    tracker: str
    twin: str
    settings: Mapping[str, type] = field(default_factory=dict)
    defaults: Mapping[str, object] = field(default_factory=dict)
    shares_launches: bool = False


#: Every registered search.
SEARCHES = Registry(SearchSpec, "apf.filters.searches", "SEARCH", "psfs_apf.searches")
