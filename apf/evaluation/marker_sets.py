"""The marker sets that are shipped."""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent / "markers"
#: Names of the sets that are shipped.
SHIPPED = tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))
