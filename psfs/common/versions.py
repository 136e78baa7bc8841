"""Versions of this program and of its libraries, for the provenance of results."""

from __future__ import annotations

import platform


def versions() -> dict[str, str]:
    """Return the versions of this program, of Python and of the libraries that affect results."""
    from importlib import metadata  # takes 20 ms

    packages = ("psfs-apf", "numpy", "pyopencl", "opencv-python-headless", "scipy")
    found = {"python": platform.python_version()}
    for package in packages:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:  # another flavour of the same library
            found[package] = "unknown"
    return found
