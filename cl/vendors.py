"""Registration of drivers from Python packages with OpenCL's loader."""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Iterator
from functools import cache
from importlib import metadata
from pathlib import Path

from cl.folders import cache_folder, write_whole

#: Its wheel's own `.icd` file names a folder that exists on no machine.
_INTEL_PACKAGE = "intel-opencl-rt"
_INTEL_LIBRARIES = ("libintelocl.so", "intelocl64.dll")
_SYSTEM_FOLDERS = (Path("/etc/OpenCL/vendors"), Path(sys.prefix) / "etc/OpenCL/vendors")


@cache
def register_packaged_drivers() -> None:
    """Make Intel's CPU runtime (the extra `intel`) known to OpenCL's loader, if it is installed.

    The loader reads the environment at OpenCL's first call, so this comes before it. A user's own
    OCL_ICD_VENDORS is left as it is.
    """
    library = intel_library()
    if library is None or "OCL_ICD_VENDORS" in os.environ:
        return
    # The Khronos loader (Windows, conda) takes further libraries from here.
    named = [os.environ.get("OCL_ICD_FILENAMES"), str(library)]
    os.environ["OCL_ICD_FILENAMES"] = os.pathsep.join(filter(None, named))
    if sys.platform.startswith("linux"):
        # pyopencl's wheels carry ocl-icd, which takes one folder beside their own drivers.
        libraries = [*_system_libraries(), str(library)]
        os.environ["OCL_ICD_VENDORS"] = str(_vendors_folder(libraries))


def intel_library() -> Path | None:
    """Return the library of Intel's CPU runtime as installed by pip, None if it is not."""
    try:
        files = metadata.files(_INTEL_PACKAGE) or []
    except metadata.PackageNotFoundError:
        return None
    found = (Path(str(file.locate())).resolve() for file in files if file.name in _INTEL_LIBRARIES)
    return next((path for path in found if path.is_file()), None)


def _system_libraries() -> Iterator[str]:
    """Yield the libraries that the system's `.icd` files name."""
    for folder in _SYSTEM_FOLDERS:
        for path in sorted(folder.glob("*.icd")):
            library = path.read_text(encoding="utf-8", errors="replace").strip()
            if Path(library).is_file() or not Path(library).is_absolute():
                yield library


def _vendors_folder(libraries: list[str]) -> Path:
    """Return a folder with an `.icd` file for each library, in the cache."""
    libraries = list(dict.fromkeys(libraries))
    name = hashlib.sha256("\n".join(libraries).encode()).hexdigest()[:12]
    folder = cache_folder() / f"vendors-{name}"
    for number, library in enumerate(libraries):
        path = folder / f"{number}.icd"
        if not path.is_file():
            write_whole(path, library + "\n")
    return folder
