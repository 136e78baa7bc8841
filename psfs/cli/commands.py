"""The commands of `psfs`, in the order of the work, as --help has them."""

from __future__ import annotations

from psfs.cli.program import list_commands

EXAMPLE = "psfs info FOLDER; psfs reconstruct FOLDER -o OUT; psfs view OUT"
COMMANDS = list_commands(
    "psfs",
    {
        "footage and cameras": {
            "info": "Cameras, frames and warnings of a sequence",
            "calibrate": "Find the cameras from a board or a wand that was waved through the "
            "volume, or from a person",
            "convert": "Write any footage that can be read as a native folder",
        },
        "voxels": {
            "reconstruct": "Reconstruct a voxel cloud per frame",
            "mesh": "Make closed surfaces of reconstructed frames",
        },
        "a look at them": {
            "silhouettes": "Show the silhouettes that are reconstructed from as pictures",
            "check": "Compare reprojected clouds with the silhouettes of their frames",
            "view": "Play a run on a page in the browser, or write a picture",
        },
        "this computer": {"devices": "Try the OpenCL devices and list them"},
    },
)
