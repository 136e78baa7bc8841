"""The versions of what computed."""

from __future__ import annotations

import platform


def versions() -> dict[str, str]:
    """Return the versions of what computed: this program, Python and the libraries that matter."""
    from importlib import metadata  # takes 20 ms

    packages = ("psfs-apf", "numpy", "pyopencl", "opencv-python-headless", "scipy")
    found = {"python": platform.python_version()}
    for package in packages:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:  # another flavour of the same library
            found[package] = "unknown"
    return found
