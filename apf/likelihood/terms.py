"""The terms of the voxels' likelihood that are registered, each with its settings.

Packages register others by the entry point psfs_apf.terms. Launchers and twins are named, not
imported: settings are read without OpenCL. docs/add_a_stage.md explains how to write a term.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from psfs.common.config import Config, nonnegative
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
    chosen_weight: that --likelihood gives the term where its default is 0.
    """

    name: str
    settings: type[TermSettings]
    launcher: str
    twin: str
    parity: Parity
    chosen_weight: float = 0.0


class ContourConfig(Config):
    """Change of the pictures across the outlines of limbs and head, averaged over the parts of the
    outlines that a camera sees."""

    weight: float = nonnegative(
        8.0,
        "Weight of 1 minus that mean in one camera's error.",
        "tuned: 4 to 12 differ little",
    )


class PartColourConfig(Config):
    """Agreement of the pictures with the colours of the body's parts. The term is the mean log
    likelihood ratio of the visible colours, on their part relative to the whole person, over the
    limbs and head that a camera sees."""

    weight: float = nonnegative(
        4.0,
        "Weight of that mean, as a share of its bound, in one camera's error.",
        "tuned with `surface_weight`: 1 gains half as much, 8 nothing more",
    )


_CONTOUR = TermSpec(
    "contour",
    ContourConfig,
    launcher="apf.likelihood.contour:Contours",
    twin="apf.reference.likelihood.contour:NumpyContours",
    parity=Parity(
        {"weight": 1.5},
        ("tracking/contour.differentiate", "tracking/contour.find_contours"),
        atol=0.02,  # of each camera: rounding moves a sample to the next pixel
    ),
)
_PART_COLOUR = TermSpec(
    "part_colour",
    PartColourConfig,
    launcher="apf.likelihood.part_colour:PartColours",
    twin="apf.reference.likelihood.part_colour:NumpyPartColours",
    parity=Parity(
        {"weight": 1.5},
        (
            "tracking/part_colour.encode_colours",
            "tracking/part_colour.count_colours",
            "tracking/part_colour.learn_colours",
        ),
        atol=0.02,  # of each camera: rounding moves a sample to the next pixel
    ),
)

#: Every registered term.
TERMS = Registry(TermSpec, "psfs_apf.terms", (_CONTOUR, _PART_COLOUR))
