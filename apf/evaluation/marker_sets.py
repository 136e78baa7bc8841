"""Names of the shipped marker sets."""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent / "markers"
#: Names of the shipped sets.
SHIPPED = tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))
