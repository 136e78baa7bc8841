"""Flags that several commands of both programs have."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from psfs.reconstructor import ReconstructionConfig


def read_reconstruction(values: Mapping[str, Any], where: str) -> ReconstructionConfig:
    """Return the settings of a table [reconstruction]. Raises InputError."""
    from psfs.reconstructor import ReconstructionConfig

    return ReconstructionConfig.from_dict(values, where)
