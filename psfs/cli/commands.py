"""The commands of `psfs`, in the order of the work, as --help has them."""

from __future__ import annotations

from psfs.cli.program import list_commands

EXAMPLE = "psfs info FOLDER; psfs reconstruct FOLDER -o OUT; psfs view OUT"
COMMANDS = list_commands(
    "psfs",
    {
        "footage and cameras": {
            "info": "cameras, frames and warnings of a sequence",
            "calibrate": "find the cameras from a board or a wand that was waved through the "
            "volume, or from a person",
            "convert": "write any footage that can be read as a native folder",
        },
        "voxels": {
            "reconstruct": "reconstruct a voxel cloud per frame",
            "mesh": "make closed surfaces of reconstructed frames",
        },
        "a look at them": {
            "silhouettes": "show the silhouettes that are reconstructed from as pictures",
            "check": "compare reprojected clouds with the silhouettes of their frames",
            "view": "play a run on a page in the browser, or write a picture",
        },
        "this computer": {"devices": "try the OpenCL devices and list them"},
    },
)
