"""The tree of settings: whole, documented, and as docs/settings.md says."""

import subprocess
import sys
from pathlib import Path

import pytest

import apf.presets
import apf.settings
import psfs
from psfs.common.config import Config, part_kind
from psfs.common.requests import Request

ROOT = Path(__file__).parents[1]
TREE = apf.settings.Settings


def below(kind: type[Config]) -> set[type[Config]]:
    """A class of settings and its parts."""
    parts = [part_kind(field) for field in kind.model_fields.values()]
    return {kind}.union(*(below(part) for part in parts if part is not None))


def classes(kind: type[Config] = Config) -> set[type[Config]]:
    """All classes of settings that are part of the programs."""
    known = [k for k in kind.__subclasses__() if k.__module__.startswith(("psfs.", "apf."))]
    # A class that registered parts were added to is not the one that its module has.
    known = [k for k in known if not issubclass(k, Request)]  # which is made of settings
    found = {getattr(sys.modules[k.__module__], k.__name__) for k in known}
    return found.union(*(classes(k) for k in found))


def test_every_class_of_settings_is_in_the_tree() -> None:
    outside = {apf.presets.Preset}  # a choice of it
    assert classes() - outside == below(TREE)
    assert len(below(TREE)) > 30
    public = below(psfs.ReconstructionConfig) | below(apf.Method)
    homes = {kind: psfs if kind.__module__.startswith("psfs.") else apf for kind in public}
    assert all(getattr(home, kind.__name__) is kind for kind, home in homes.items())


@pytest.mark.parametrize("kind", sorted(below(TREE), key=lambda k: k.__qualname__))
def test_defaults_are_in_their_ranges(kind: type[Config]) -> None:
    assert kind.from_dict(kind().to_dict()) == kind()


def test_the_page_is_that_of_the_code() -> None:
    command = [sys.executable, "-c", "from settings_table import page; print(page(), end='')"]
    made = subprocess.run(command, capture_output=True, text=True, cwd=ROOT / "scripts", check=True)
    page = (ROOT / "docs" / "settings.md").read_text(encoding="utf-8")
    assert made.stdout == page, "run python scripts/settings_table.py"
