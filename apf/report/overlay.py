"""The tracked body drawn over every camera's picture: pictures, and a video of all frames."""

from __future__ import annotations

import math
from collections.abc import Callable
from collections.abc import Sequence as Items
from pathlib import Path

import cv2
import numpy as np

from apf.body.cones import project_outlines
from apf.body.kinematics import posed_cones
from apf.body.model import BodyModel, find_side
from apf.tracking.track import Track
from cl import InputError
from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.scaling import scale_picture
from psfs.common.cones import CONE_FLOATS
from psfs.output.preview import crop_view
from psfs.output.video import write_video
from psfs.sequence import Frame, Sequence

#: BGR by side, bright enough for dark pictures and grey ones; the plots' hues.
COLOURS = {"left": (255, 170, 60), "right": (40, 120, 255), "middle": (120, 230, 70)}
_JOINT, _SHADOW, _TEXT = (255, 255, 255), (25, 25, 25), (245, 245, 245)
#: The mosaic's largest width and height, px.
MOSAIC_SIZE = (1920, 1080)
_BITS = 4  # fractional bits of the coordinates that OpenCV draws with
_FAR = 10_000.0  # px; lines are clipped there, because OpenCV's integers would overflow


def draw_overlay(
    image: np.ndarray,
    camera: Camera,
    cones: np.ndarray,
    cone_names: Items[str],
    joints: np.ndarray,
    edges: np.ndarray,
    *,
    colour: tuple[int, int, int] | None = None,
) -> np.ndarray:
    """Return a copy of `image` with the body: (h, w, 3) uint8 BGR as `camera` sees it.

    cones: (C, 16) posed cones, outlined in `colour`, BGR, else in one colour per side of the body.
    joints: (J, 3) m, joined along edges (E, 2) in that colour, or in white. What lies behind the
    camera is left out.
    """
    corners = project_outlines(camera, cones)
    drawn = np.ascontiguousarray(image).copy()
    thickness = max(1, round(min(camera.size) / 320))
    distance = np.linalg.norm((cones[:, 0:3] + cones[:, 4:7]) / 2 - camera.centre, axis=-1)
    visible = [
        (_to_fixed_point(corners[i]), colour or COLOURS[find_side(cone_names[i])])
        for i in np.argsort(-distance)  # near ones are drawn over far ones
        if np.isfinite(corners[i]).all()
    ]
    tint = drawn.copy()
    for quad, shade in visible:
        cv2.fillConvexPoly(tint, cv2.convexHull(quad), shade, cv2.LINE_AA, _BITS)
    cv2.addWeighted(tint, 0.16, drawn, 0.84, 0, dst=drawn)
    for quad, shade in visible:  # a dark rim keeps the lines visible on any background
        cv2.polylines(drawn, [quad], True, _SHADOW, thickness + 2, cv2.LINE_AA, _BITS)
        cv2.polylines(drawn, [quad], True, shade, thickness, cv2.LINE_AA, _BITS)
    _draw_skeleton(drawn, *camera.project(joints), edges, thickness, colour or _JOINT)
    return drawn


def _draw_skeleton(
    image: np.ndarray,
    pixels: np.ndarray,
    depth: np.ndarray,
    edges: np.ndarray,
    thickness: int,
    colour: tuple[int, int, int],
) -> None:
    seen = depth > 0
    points = _to_fixed_point(pixels)
    for a, b in edges:
        if seen[a] and seen[b]:
            cv2.line(image, points[a], points[b], colour, 1, cv2.LINE_AA, _BITS)
    radius = round((0.8 + 0.7 * thickness) * 2**_BITS)
    for point in points[seen]:
        cv2.circle(image, point, radius + 2**_BITS, _SHADOW, -1, cv2.LINE_AA, _BITS)
        cv2.circle(image, point, radius, _JOINT, -1, cv2.LINE_AA, _BITS)


def _to_fixed_point(pixels: np.ndarray) -> np.ndarray:
    """Return pixels (..., 2) as the integers with `_BITS` fractional bits that OpenCV draws."""
    return np.rint(np.clip(pixels, -_FAR, _FAR) * 2**_BITS).astype(np.int32)


def overlay_picture(
    frame: Frame,
    rig: CameraRig,
    cones: np.ndarray,
    cone_names: Items[str],
    joints: np.ndarray,
    edges: np.ndarray,
    *,
    views: Items[int] | None = None,
    note: str = "",
) -> np.ndarray:
    """Return a frame's mosaic (h, w, 3) uint8 BGR: all cameras, or those of `views`, with the body.

    note: written beside the frame's number. Where the frame has no images it is drawn on the
    masks. Arguments as in `draw_overlay`.
    """

    def draw(image: np.ndarray, camera: Camera) -> np.ndarray:
        return draw_overlay(image, camera, cones, cone_names, joints, edges)

    return compose_mosaic(frame, rig, draw, views, note)


def compose_mosaic(
    frame: Frame,
    rig: CameraRig,
    draw: Callable[[np.ndarray, Camera], np.ndarray],
    views: Items[int] | None = None,
    note: str = "",
) -> np.ndarray:
    """Return a frame's mosaic (h, w, 3) uint8 BGR of the cameras' pictures, each with what `draw`
    makes of it; views and note as in `overlay_picture`. It has even sides within MOSAIC_SIZE."""
    chosen = range(len(rig)) if views is None else views
    columns, scale = _arrangement(len(chosen), rig.width, rig.height)
    width, height = (max(2, math.floor(scale * side / 2) * 2) for side in (rig.width, rig.height))
    rows = -(-len(chosen) // columns)
    mosaic = np.zeros((rows * height, columns * width, 3), np.uint8)
    for tile, view in enumerate(chosen):
        camera = rig[view].scaled(scale)
        picture = scale_picture(crop_view(frame, view, rig[view]), scale)[:height, :width]
        picture = draw(np.ascontiguousarray(picture), camera)
        _label(picture, f"{camera.name}   frame {frame.index}{note}")
        y, x = height * (tile // columns), width * (tile % columns)
        mosaic[y : y + len(picture), x : x + picture.shape[1]] = picture
    return mosaic


def _arrangement(n: int, width: int, height: int) -> tuple[int, float]:
    """Return columns and scale, 1 at most, for n tiles: those that would be largest within
    MOSAIC_SIZE, as a page shows them, fewest empty, then widest."""

    def key(columns: int) -> tuple[float, int, int]:
        rows = -(-n // columns)
        scale = min(MOSAIC_SIZE[0] / (columns * width), MOSAIC_SIZE[1] / (rows * height))
        return round(scale, 6), -rows * columns, columns

    columns = max(range(1, n + 1), key=key)
    return columns, min(1.0, key(columns)[0])


def _label(image: np.ndarray, text: str) -> None:
    """Draw white text on a dark strip in the upper left corner."""
    size = max(0.4, min(image.shape[:2]) / 800)
    font = cv2.FONT_HERSHEY_SIMPLEX
    (width, height), below = cv2.getTextSize(text, font, size, 1)
    pad = round(12 * size)
    strip = image[: height + below + pad, : width + 2 * pad]
    strip[:] = strip // 3
    cv2.putText(image, text, (pad, height + pad // 2), font, size, _TEXT, 1, cv2.LINE_AA)


def write_overlay(
    path: str | Path,
    sequence: Sequence,
    track: Track,
    body: BodyModel | None,
    progress: Callable[[], object] | None = None,
) -> None:
    """Write an mp4 of the track's frames as `overlay_picture` shows them.

    body: the scaled model that was tracked; None for the joints alone. progress: called after each
    frame. Plays as fast as the scene (slower below 1 frame/s). Raises InputError when a frame is
    not in the sequence or the video cannot be written.
    """
    cones, cone_names = posed_shown_cones(body, track)
    with write_video(path, frame_rate(track)) as video:
        indices = check_indices(sequence, track.frames)
        for row, frame in enumerate(sequence.select_frames(indices)):
            picture = overlay_picture(
                frame,
                sequence.rig,
                cones[row],
                cone_names,
                track.joints[row],
                track.edges,
                note="   LOST" if track.lost[row] else "",
            )
            video.write(picture)
            if progress is not None:
                progress()


def posed_shown_cones(body: BodyModel | None, track: Track) -> tuple[np.ndarray, list[str]]:
    """Return the posed cones (F, C, 16) that are compared with images, and their names."""
    if body is None:
        return np.zeros((len(track), 0, CONE_FLOATS)), []
    shown = [i for i, cone in enumerate(body.cones) if cone.in_images]
    return posed_cones(body, track.poses)[:, shown], [body.cone_names[i] for i in shown]


def check_indices(sequence: Sequence, indices: np.ndarray) -> list[int]:
    """Return frame numbers (F,) of a track as a list. Raises InputError if there is none, or one
    that the sequence does not have."""
    if not indices.size:
        raise InputError("the track holds no frame to draw")
    if indices.min() < 0 or indices.max() >= len(sequence):
        raise InputError(
            f"{sequence.folder}: the track has frames {indices.min()}..{indices.max()}; "
            f"the sequence {len(sequence)}"
        )
    return [int(index) for index in indices]


def frame_rate(track: Track) -> float:
    """Return the pictures per second with which a video of the track's frames plays as fast as the
    scene, 1 at least."""
    steps = np.diff(track.frames)
    return max(1.0, track.fps / max(1.0, float(np.median(steps)) if steps.size else 1.0))
