"""The one place that says how a tracked body is drawn: its parts, their colours, its outline over
pictures. Overlay, report, studio and thumbnails draw `Figure`s."""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Iterable
from collections.abc import Sequence as Items
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from apf.body.cones import outline_rings
from apf.body.kinematics import posed_cones, posed_joints
from apf.body.limbs import limb_bones
from apf.body.model import BodyModel, find_side
from apf.tracking.people import PeopleTracks, person_folder
from apf.tracking.track import Track
from cl import InputError
from psfs.cameras.camera import MOST_CAMERAS, Camera, CameraRig
from psfs.common.pictures import scale_picture
from psfs.common.progress import map_in_threads
from psfs.output.preview import crop_view, label_picture
from psfs.output.video import write_video
from psfs.sequence import Frame, Sequence

#: RGB of a side of the body, bright enough for dark pictures and grey ones; and of what is lost.
#: People who are colour-blind distinguish them.
SIDES = {"left": (60, 170, 255), "right": (255, 120, 40), "middle": (70, 230, 120)}
LOST = (120, 0, 80)
#: RGB of several people; they repeat.
PEOPLE = (
    (83, 145, 207), (230, 155, 109), (129, 189, 143), (185, 145, 203), (214, 126, 117),
    (169, 149, 129), (226, 159, 197), (150, 161, 172),
)  # fmt: skip
_LOST = np.array(LOST, np.uint8)
_JOINT, _RIM = (255, 255, 255), (25, 25, 25)
#: The mosaic's largest width and height, px.
MOSAIC_SIZE = (1920, 1080)
#: Rim around the joints in a cropped picture, as a share of the larger side that they span.
_RIM_SHARE = 0.15
_MACROBLOCK = 16  # px, of H.264; videos of whole ones are the same bytes each time
_BITS = 4  # fractional bits of the coordinates that OpenCV draws with
_FAR = 10_000.0  # px; lines are clipped there, because OpenCV's integers would overflow


class Figure:
    """A tracked person as drawn everywhere.

    name: of the person. number: among several, who have a colour each; None for the only one, whose
    parts have the colours of their sides. Lost limbs, and a lost person, have the colour LOST.
    seen: frames (F,) that show the person; all without. rows: of the track, by the numbers of these
    frames. lost: rows (F,) bool in which the person is lost.
    """

    def __init__(
        self,
        track: Track,
        name: str = "",
        number: int | None = None,
        seen: np.ndarray | None = None,
    ) -> None:
        self.track, self.name, body = track, name, track.body
        self.colour = None if number is None else PEOPLE[number % len(PEOPLE)]
        there = track.present if seen is None else track.present & np.isin(track.frames, seen)
        self.rows = {int(track.frames[row]): int(row) for row in np.flatnonzero(there)}
        ends = (track.joint_names[end] for _, end in track.edges)
        self._edge_colours = self._pick_colours(ends)
        self._cones = None if body is None else posed_cones(body, track.poses)
        self._cone_colours = self._pick_colours(body.cone_names if body is not None else ())
        self.lost = track.lost  # computed at each call
        self._lost_cones = np.repeat(self.lost[:, None], len(self._cone_colours), axis=1)
        if body is not None and body.cones:
            lost_bones = (track.lost_limbs @ limb_bones(body)).astype(bool)
            self._lost_cones |= lost_bones[:, [cone.bone for cone in body.cones]]

    def colour_cones(self, row: int) -> np.ndarray:
        """Return the colours (C, 3) uint8 of the body's cones."""
        return np.where(self._lost_cones[row][:, None], _LOST, self._cone_colours)

    def colour_edges(self, row: int) -> np.ndarray:
        """Return the colours (E, 3) uint8 of the skeleton's edges."""
        return np.where(self.lost[row], _LOST, self._edge_colours)

    def colour_joints(self, joints: Items[int]) -> np.ndarray:
        """Return the colours (n, 3) uint8 of joints, by their indices."""
        return self._pick_colours(self.track.joint_names[joint] for joint in joints)

    def draw(self, image: np.ndarray, camera: Camera, row: int) -> None:
        """Draw the body in a row of the track over `image` (h, w, 3) uint8 BGR as `camera` sees it;
        nothing of what lies behind the camera."""
        thickness = max(1, round(min(camera.size) / 320))
        if self._cones is not None and len(self._cone_colours):
            colours = self.colour_cones(row)[:, ::-1].tolist()
            _draw_cones(image, camera, self._cones[row], colours, thickness)
        colour = _JOINT if self.colour is None else self.colour[::-1]
        pixels, depth = camera.project(self.track.joints[row])
        visible, points = depth > 0, _to_fixed_point(pixels)
        for a, b in self.track.edges:
            if visible[a] and visible[b]:
                cv2.line(image, points[a], points[b], colour, 1, cv2.LINE_AA, _BITS)
        radius = round((0.8 + 0.7 * thickness) * 2**_BITS)
        for point in points[visible]:
            cv2.circle(image, point, radius + 2**_BITS, _RIM, -1, cv2.LINE_AA, _BITS)
            cv2.circle(image, point, radius, _JOINT, -1, cv2.LINE_AA, _BITS)

    def pack(self, frames: np.ndarray) -> dict[str, Any]:
        """Return the skeleton in frames (F,) for the script of a page: joints (F, J, 3) m, NaN
        where the person is not seen, as base64 of little-endian float32."""
        rows = [self.rows.get(int(frame)) for frame in frames]
        unseen = np.full(self.track.joints.shape[1:], np.nan)
        joints = [unseen if row is None else self.track.joints[row] for row in rows]
        return {
            "name": self.name,
            "colour": None if self.colour is None else css(self.colour),
            "joint_names": list(self.track.joint_names),
            "edges": self.track.edges.tolist(),
            "edge_colours": [css(colour) for colour in self._edge_colours.tolist()],
            "joints": encode(np.stack(joints), "<f4"),
            "shown": [int(row is not None) for row in rows],
            "lost_at": [int(row is not None and self.lost[row]) for row in rows],
        }

    def _pick_colours(self, names: Iterable[str]) -> np.ndarray:
        colours = [self.colour or SIDES[find_side(name)] for name in names]
        return np.array(colours, np.uint8).reshape(-1, 3)


def make_figures(tracks: PeopleTracks) -> list[Figure]:
    """Return the figure of each person, in the frames that show the person."""
    several = len(tracks) > 1
    return [
        Figure(track, person_folder(Path(), k + 1).name, k if several else None, seen)
        for k, (track, seen) in enumerate(zip(tracks, tracks.seen, strict=True))
    ]


def make_still_figure(body: BodyModel, pose: np.ndarray, number: int | None = None) -> Figure:
    """Return the figure of a body in a pose (D,), of one frame."""
    poses = np.asarray(pose, float)[None]
    track = Track(
        body_name=body.name, dof_names=body.dof_names, joint_names=tuple(body.joint_names),
        fps=30.0, frames=np.array([0]), poses=poses, joints=posed_joints(body, poses),
        edges=np.array(body.edges), body=body,
    )  # fmt: skip
    return Figure(track, number=number)


def draw_mosaic(
    frame: Frame,
    rig: CameraRig,
    figures: Items[Figure],
    views: Items[int] | None = None,
    window: tuple[np.ndarray, np.ndarray] | None = None,
) -> np.ndarray:
    """Return a frame's mosaic (h, w, 3) uint8 BGR: all cameras, or those of `views`, with everybody
    that the frame shows, near people over far ones, and the names of those who are lost.

    window: the part of each picture that is shown, see `find_window`; all without. Where the frame
    has no images the masks are drawn on. It has even sides within MOSAIC_SIZE.
    """
    chosen = range(len(rig)) if views is None else views
    corners, (wide, high) = window or (np.zeros((len(rig), 2), int), (rig.width, rig.height))
    columns, scale = _arrangement(len(chosen), wide, high)
    width, height = (max(2, math.floor(scale * side / 2) * 2) for side in (wide, high))
    mosaic = np.zeros((-(-len(chosen) // columns) * height, columns * width, 3), np.uint8)
    shown = [(one, one.rows[frame.index]) for one in figures if frame.index in one.rows]
    shown = [(one, row) for one, row in shown if np.isfinite(one.track.joints[row]).any()]
    lost = [f"   {one.name} LOST" for one, row in shown if one.lost[row]]
    note = ("   LOST" if lost else "") if len(figures) == 1 else "".join(lost)
    for tile, view in enumerate(chosen):
        left, top = corners[view].tolist()
        camera = _crop_camera(rig[view], left, top, scale)
        part = crop_view(frame, view, rig[view])[top : top + high, left : left + wide]
        picture = scale_picture(part, scale)[:height, :width]
        picture = np.ascontiguousarray(picture).copy()
        centres = [np.nanmean(one.track.joints[row], axis=0) for one, row in shown]
        away = [-float(np.linalg.norm(centre - camera.centre)) for centre in centres]
        for k in np.argsort(away):
            shown[k][0].draw(picture, camera, shown[k][1])
        label_picture(picture, f"{camera.name}   frame {frame.index}{note}")
        y, x = height * (tile // columns), width * (tile % columns)
        mosaic[y : y + len(picture), x : x + picture.shape[1]] = picture
    return mosaic


@lru_cache(MOST_CAMERAS)
def _crop_camera(camera: Camera, left: int, top: int, scale: float) -> Camera:
    """Return the camera of a scaled part of the pictures, which begins at a pixel."""
    K = camera.K - np.array([[0, 0, left], [0, 0, top], [0, 0, 0]])
    return replace(camera, K=K, hidden=None).scaled(scale)


def find_window(rig: CameraRig, figures: Items[Figure]) -> tuple[np.ndarray, np.ndarray]:
    """Return the upper left corners (V, 2) of the parts of the pictures that show everybody in all
    frames, px, and their size (2,), which is the same in all pictures."""
    points = np.concatenate([one.track.joints[[*one.rows.values()]] for one in figures])
    sizes = np.array([camera.size for camera in rig])
    boxes = np.stack([np.zeros_like(sizes), sizes], axis=1).astype(float)
    for view, camera in enumerate(rig):
        pixels, depth = camera.project(points.reshape(-1, 3))
        seen = pixels[(depth > 0) & np.isfinite(pixels).all(axis=-1)]
        if len(seen):
            rim = _RIM_SHARE * np.ptp(seen, axis=0).max()
            boxes[view] = np.clip([seen.min(0) - rim, seen.max(0) + rim], 0, sizes[view])
    blocks = np.ceil(np.diff(boxes, axis=1)[:, 0].max(axis=0) / _MACROBLOCK)
    size = np.minimum(_MACROBLOCK * blocks.astype(int), (rig.width, rig.height))
    corners = np.rint(boxes.mean(axis=1) - size / 2).astype(int)
    return np.clip(corners, 0, np.maximum(sizes - size, 0)), size


def write_overlay(
    path: str | Path,
    sequence: Sequence,
    tracks: Track | PeopleTracks,
    progress: Callable[[], object] = lambda: None,
) -> None:
    """Write an mp4 of the tracked frames as `draw_mosaic` shows them, cropped to the people.

    progress: called after each frame. Plays as fast as the scene (slower below 1 frame/s). Raises
    InputError when a frame is not in the sequence or the video cannot be written.
    """
    everybody = PeopleTracks.of(tracks) if isinstance(tracks, Track) else tracks
    figures, frames = make_figures(everybody), everybody.frames
    steps = np.diff(frames)
    step = max(1.0, float(np.median(steps)) if steps.size else 1.0)
    window = find_window(sequence.rig, figures)
    pictures = sequence.select_frames(check_indices(sequence, frames))
    draw = partial(draw_mosaic, rig=sequence.rig, figures=figures, window=window)
    with write_video(path, max(1.0, everybody[0].fps / step)) as video:
        for mosaic in map_in_threads(draw, pictures):
            video.write(mosaic)
            progress()


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


def css(colour: Items[int]) -> str:
    """Return an RGB colour as CSS has it."""
    return "rgb({}, {}, {})".format(*colour)


def encode(values: np.ndarray, kind: str) -> str:
    """Return numbers as base64 of the little-endian type `kind`."""
    return base64.b64encode(np.ascontiguousarray(values).astype(kind).tobytes()).decode()


def _draw_cones(
    image: np.ndarray, camera: Camera, cones: np.ndarray, colours: list[Any], thickness: int
) -> None:
    """Tint cones (C, 16), near ones over far ones, and draw the outline of all together."""
    rings, depth = camera.project(outline_rings(camera.centre, cones))
    distance = np.linalg.norm((cones[:, 0:3] + cones[:, 4:7]) / 2 - camera.centre, axis=-1)
    seen = np.all(depth > 0, axis=-1) & np.all(np.isfinite(rings), axis=(-2, -1))
    if not seen.any():
        return
    rim = thickness + 2  # dark, so that the line is visible on any background
    low = np.clip(rings[seen].min((0, 1)) - rim, 0, camera.size).astype(int)
    high = np.clip(rings[seen].max((0, 1)) + rim + 1, 0, camera.size).astype(int)
    image = image[low[1] : high[1], low[0] : high[0]]
    if not image.size:
        return
    order = [i for i in np.argsort(-distance) if seen[i]]
    table = np.array([(0, 0, 0), *(colours[i] for i in order)], np.uint8)
    number = np.zeros(image.shape[:2], np.uint8)  # of the nearest cone, counted from far to near
    for k, points in enumerate(_to_fixed_point(rings[order] - low), start=1):
        cv2.fillConvexPoly(number, cv2.convexHull(points), k, cv2.LINE_8, _BITS)
    inside = number > 0
    tinted = cv2.addWeighted(image, 0.84, np.take(table, number, axis=0), 0.16, 0)
    cv2.copyTo(tinted, inside.view(np.uint8), image)
    lines, _ = cv2.findContours(inside.view(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    nearest = np.asarray(cv2.dilate(number, np.ones((rim, rim), np.uint8)), np.uint8)
    drawn = np.zeros_like(number)
    cv2.drawContours(image, lines, -1, _RIM, rim)
    cv2.drawContours(drawn, lines, -1, 255, thickness)
    cv2.copyTo(np.take(table, nearest, axis=0), drawn, image)


def _to_fixed_point(pixels: np.ndarray) -> np.ndarray:
    """Return pixels (..., 2) as the integers with `_BITS` fractional bits that OpenCV draws."""
    return np.rint(np.clip(pixels, -_FAR, _FAR) * 2**_BITS).astype(np.int32)


def _arrangement(n: int, width: int, height: int) -> tuple[int, float]:
    """Return columns and scale, 1 at most, for n tiles: those that would be largest within
    MOSAIC_SIZE, as a page shows them, fewest empty, then widest."""

    def key(columns: int) -> tuple[float, int, int]:
        rows = -(-n // columns)
        scale = min(MOSAIC_SIZE[0] / (columns * width), MOSAIC_SIZE[1] / (rows * height))
        return round(scale, 6), -rows * columns, columns

    columns = max(range(1, n + 1), key=key)
    return columns, min(1.0, key(columns)[0])
