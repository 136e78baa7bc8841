"""The terms of the voxels' likelihood that are registered, each with its settings.

Every module here registers one, and packages register others by the entry point psfs_apf.terms.
Launchers and twins are named, not imported: settings are read without OpenCL. docs/add_a_stage.md
explains how to write a term.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from psfs.common.registry import Registry


class TermSettings(Protocol):
    """Settings of a term: a config whose fields all have defaults."""

    @property
    def weight(self) -> float:
        """Weight of the term in one camera's error; 0 turns the term off."""


@dataclass(frozen=True)
class Parity:
    """A term's row in the parity test, tests/apf/likelihood/test_terms.py.

    settings: of the term there, by name; its weight is positive. kernels: "stage.kernel" that run
    then. rtol, atol: by which errors may differ from the twin's.
    """

    settings: Mapping[str, float]
    kernels: tuple[str, ...]
    rtol: float = 1e-4
    atol: float = 1e-5


@dataclass(frozen=True)
class TermSpec:
    """A term as it is registered: in `TERMS`, or by the entry point psfs_apf.terms of a package.

    name: by which --likelihood chooses it, and of its table in [method.filter.likelihood].
    settings: their class; a term of another package has a weight of 0 by default, so that nothing
    changes where it is installed. launcher, twin: a `Term` and a `TermTwin`, as
    "package.module:Class"; they are imported when they are used. parity: its row in the test.
    chosen_weight: that --likelihood gives the term where its default is 0. depends_on_track:
    whether it remembers what it has room for once, not once per run. per_interval: settings that
    are stated for 60 frames/s and grow with the time between frames.
    """

    name: str
    settings: type[TermSettings]
    launcher: str
    twin: str
    parity: Parity
    chosen_weight: float = 0.0
    depends_on_track: bool = False
    per_interval: tuple[str, ...] = ()


#: Every registered term.
TERMS = Registry(TermSpec, "apf.likelihood.terms", "TERM", "psfs_apf.terms")
