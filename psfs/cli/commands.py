"""The commands of `psfs`, in the order of --help."""

from __future__ import annotations

from psfs.cli.program import list_commands

COMMANDS = list_commands(
    "psfs",
    info="cameras, frames and warnings of a sequence",
    calibrate="find the cameras from a board or a wand that was waved through the volume",
    convert="write any footage that can be read as a native folder",
    reconstruct="reconstruct a voxel cloud per frame",
    silhouettes="show the silhouettes that are reconstructed from as pictures",
    check="compare reprojected clouds with the silhouettes of their frames",
    mesh="make closed surfaces of reconstructed frames",
    view="play a run on a page in the browser, or write a picture",
    devices="try the OpenCL devices and list them",
)
