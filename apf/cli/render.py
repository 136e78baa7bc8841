"""`apf render`: pictures of what the image objectives compare with the images."""

from __future__ import annotations

import colorsys
from pathlib import Path

import cv2
import numpy as np

from apf.backend import draw_poses
from apf.cli.opened_track import open_given_tracks
from apf.image_objective.config import ObjectiveConfig
from apf.image_objective.opengl.renderer import draw_by_opengl
from apf.request import RenderRequest
from apf.scene import Scene
from apf.tracking.people import holds_people, person_folder
from cl import InputError, select_device
from psfs.cli.commandline import progress_bar, stdout, warn
from psfs.common.files import write_picture
from psfs.common.outputs import OutputFolder, output_folder
from psfs.common.requests import SETTINGS, write_settings
from psfs.opening import open_sequence, select_common_frames
from psfs.output.preview import crop_view

#: The kinds of pictures, each in its own folder.
KINDS = ("silhouettes", "edges", "overlay")
_WHITE, _TINT = (255, 255, 255), 0.45


def run(request: RenderRequest) -> None:
    if holds_people(request.track):
        raise InputError(
            f"{request.track}: of several people, and each picture is of one body; expected one's "
            f"folder, as {person_folder(request.track, 1)}"
        )
    if request.opengl:
        request.refuse(["round_ends", "device"], "is OpenCL's; expected none with --opengl")
    look = request.look
    files = (look.mesh_file, look.mesh_weights, look.mesh_pose)
    given = [Path(path) for path in files if path]
    inputs = [Path(request.folder), request.track, *given]
    with output_folder(request.output, request.COMMAND, inputs, (SETTINGS,)) as out:
        _render(request, out, look)


def _render(request: RenderRequest, out: OutputFolder, look: ObjectiveConfig) -> None:
    device = None if request.opengl else select_device(request.device)
    sequence = open_sequence(request)
    out.check_inputs(sequence.inputs)
    chosen = select_common_frames(request.frames, sequence, warn)
    track = open_given_tracks(request)[0]
    body = track.its_body
    rows = [row for row, frame in enumerate(track.frames) if frame in chosen]
    if not rows:
        raise InputError(
            f"{request.track}: has none of the frames {chosen.start} to {chosen.stop - 1}"
        )
    mesh = look.mesh(body)
    hues = [colorsys.hsv_to_rgb((0.13 + 0.381966 * k) % 1, 0.75, 1.0) for k in range(256)]
    colours = np.rint(255 * np.array(hues)).astype(np.uint8)  # of the parts
    with progress_bar() as bar:
        for row in bar.track(rows, description="rendering"):
            frame = sequence.read(int(track.frames[row]))
            poses = track.poses[[row]]
            if device is None:
                drawn = draw_by_opengl(body, sequence.rig, poses, mesh)[0]
            else:
                scene = Scene(device, sequence.rig, None, body)
                drawn = draw_poses(scene, poses, mesh, look.round_ends)[0]
            for view, camera in enumerate(sequence.rig):
                width, height = camera.size
                parts, edges = np.moveaxis(drawn[view, :height, :width], -1, 0)
                name = f"{camera.name}_{frame.index:06d}.png"
                silhouette = np.where(parts > 0, np.uint8(255), np.uint8(0))
                overlay = crop_view(frame, view, camera)
                tinted = cv2.addWeighted(overlay, 1 - _TINT, colours[parts], _TINT, 0)
                overlay = np.where(parts[..., None] > 0, tinted, overlay)
                overlay[edges > 0] = _WHITE
                for kind, picture in zip(KINDS, (silhouette, edges, overlay), strict=True):
                    write_picture(request.output / kind / name, picture)
    write_settings(request.output, request)
    stdout.print(f"{len(rows)} frames x {len(sequence.rig)} cameras drawn: {request.output}")
