"""Import Open3D, here only: it takes a second, and reconstruction does not need it."""

from __future__ import annotations

import ctypes
import os
from functools import cache
from typing import Any


@cache
def load_open3d() -> Any:
    """Import open3d with the libusb of the package `libusb-package`, as bare machines have none."""
    import libusb_package

    library = libusb_package.get_library_path()
    if library:
        ctypes.CDLL(str(library), mode=ctypes.RTLD_GLOBAL)
    # In notebooks Open3D would start a web server and print a message.
    os.environ.setdefault("OPEN3D_DISABLE_WEB_VISUALIZER", "true")
    import open3d

    return open3d
