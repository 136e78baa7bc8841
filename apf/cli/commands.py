"""The commands of `apf`, in the order of the work, as --help has them."""

from __future__ import annotations

from psfs.cli.program import list_commands

EXAMPLE = "apf track FOLDER -o OUT; apf export OUT"
COMMANDS = list_commands(
    "apf",
    {
        "all of it": {
            "demo": "Generate a small sequence, reconstruct, track and evaluate it, by the "
            "commands shown",
            "studio": "Open a page in the browser: look at footage, track it, watch, correct and "
            "export",
        },
        "cameras and keypoints": {
            "synth": "Make a synthetic sequence of one person or several who walk in a room",
            "calibrate": "Find cameras and times from the keypoints of somebody who walks about",
            "keypoints": "Find 2-D keypoints in all cameras with MediaPipe Pose, for apf track "
            "--keypoints",
        },
        "tracks": {
            "body": "Show or check a body",
            "track": "Reconstruct and track one person or several, frame by frame",
            "batch": "Track many takes, folders or a TOML list of them, on all GPUs or cores, or "
            "on a Dask cluster; a second call does what the first left",
            "live": "Track while it happens; frames may be dropped",
        },
        "a look at them": {
            "report": "Judge a track and write its page, report.html, as `apf track` does: a 3-D "
            "player, the overlay, confidence, agreement with the silhouettes, angles",
            "view": "Play a track on a page in the browser, in its own voxels or those of psfs "
            "reconstruct",
            "render": "Draw a track's silhouettes and edges in every camera, as PNG",
            "evaluate": "Compare a track with the truth, joint by joint",
        },
        "files for other programs": {
            "smooth": "Smooth a track in time, after it was tracked",
            "export": "Write a track as files of motion: BVH, C3D, TRC, OpenSim's MOT, angles as "
            "CSV, GLB, gait",
        },
        "this computer": {
            "timings": "Time a frame on this computer: NumPy, one core, all cores, every OpenCL "
            "device",
        },
    },
)
