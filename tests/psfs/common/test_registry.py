"""What is registered: this program's own modules, and other packages' entry points."""

import logging
from collections.abc import Callable
from importlib.metadata import EntryPoint

import pytest

from apf.likelihood.terms import TERMS, TermSpec
from psfs.common import registry
from psfs.common.registry import Registry

OWN = ["contour", "part_colour"]
GROUP = "psfs_apf.terms"


@pytest.fixture
def registered(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Registry[TermSpec]]:
    """Make a registry where packages have these entry points."""

    def make(**values: str) -> Registry[TermSpec]:
        points = [EntryPoint(name, value, GROUP) for name, value in values.items()]
        monkeypatch.setattr(registry, "entry_points", lambda group: points)
        return Registry(TermSpec, GROUP, tuple(TERMS[name] for name in OWN))

    return make


def test_own_entries_are_those_of_the_modules(
    registered: Callable[..., Registry[TermSpec]],
) -> None:
    found = registered()
    assert list(found) == OWN and found["contour"] is TERMS["contour"] and len(found) == 2


@pytest.mark.parametrize(
    ("value", "why"),
    [
        ("nowhere_to_be_found:TERM", "No module named 'nowhere_to_be_found'"),
        ("json:dumps", "expected a TermSpec"),
        ("apf.likelihood.terms:_CONTOUR", "there is a TermSpec 'contour' already"),
    ],
)
def test_an_entry_point_that_fails_is_left_out(
    registered: Callable[..., Registry[TermSpec]],
    caplog: pytest.LogCaptureFixture,
    value: str,
    why: str,
) -> None:
    with caplog.at_level(logging.WARNING):
        assert list(registered(other=value)) == OWN
    assert f"the entry point other = {value}" in caplog.text and why in caplog.text
