"""A track compared with the truth: joints, markers, angles and people."""

from pathlib import Path

#: The shipped marker sets, by their names.
MARKER_SETS = {file.stem: file for file in sorted(Path(__file__).parent.glob("markers/*.toml"))}
