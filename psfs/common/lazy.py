"""Packages whose public names are imported when they are first asked for."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import lazy_loader


def attach_names(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return `__getattr__`, `__dir__` and `__all__` of a package, by its `__name__` and `__file__`:
    the names in its `__init__.pyi`, and `__version__`."""
    get_listed, _, names = lazy_loader.attach_stub(package, file)
    names = [*names, "__version__"]

    def get(name: str) -> Any:
        if name == "__version__":
            return importlib.import_module("importlib.metadata").version("psfs-apf")
        if name not in names:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return get_listed(name)

    return get, lambda: list(names), names
