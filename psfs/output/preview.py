"""Draw a voxel cloud from several sides, and its outline in the input pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import zip_longest

import cv2
import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.rig_geometry import voxel_footprints
from psfs.common.colours import CLAY
from psfs.common.numbers import pick_evenly
from psfs.common.pictures import scale_picture
from psfs.common.ranges import escape_unprintable
from psfs.sequence import Frame
from psfs.voxels.clouds import coarsen, estimate_normals
from psfs.voxels.grid import VoxelCloud
from psfs.voxels.host_voxels import voxel_silhouette

#: Azimuth and elevation of the views, degrees.
VIEWS = ((0, 10), (60, 10), (120, 10), (180, 10), (240, 10), (300, 25))
PANEL = (300, 420)  # width, height of a view, px
_SUPERSAMPLING = 2
BACKDROP = np.array([250, 247, 244], np.float32)  # BGR
#: Most voxels along the longest side of a cloud in a picture of `PANEL`.
_MAX_VOXELS = 250
_OUTLINE = (60, 220, 60)
_INK = (90, 80, 70)
_MASK_GREY = 0.55  # brightness of a mask drawn as a picture, so that lines stand out


def draw_preview(cloud: VoxelCloud, rig: CameraRig, frame: Frame, title: str = "") -> np.ndarray:
    """Draw a sheet (h, w, 3) uint8 BGR of a cloud.

    A row of shaded views stands above a row of the frame's pictures with the outline of the
    reprojected cloud.
    """
    shown = _coarsen_for_picture(cloud)
    views = draw_views(shown.centres, estimate_normals(shown), shown.colour, shown.grid.voxel_size)
    edge = cloud.grid.voxel_size
    text = f"{title}   {len(cloud):,} surface voxels of {_length(edge)}"
    if cloud.volume:
        text += f"   volume {cloud.volume * 1e3:.3g} l"
    extents = voxel_footprints(rig, edge)

    def silhouette(view: int) -> np.ndarray:
        columns, rows = rig[view].size
        return voxel_silhouette(rig[view], cloud.centres, extents[view], (rows, columns))

    return draw_sheet(views, text, silhouette, rig, frame)


def _coarsen_for_picture(cloud: VoxelCloud) -> VoxelCloud:
    """Return the cloud in voxels no finer than a small picture shows."""
    if not len(cloud):
        return cloud
    ijk = np.stack(np.unravel_index(cloud.indices, cloud.grid.shape))
    longest = int(np.ptp(ijk, axis=1).max()) + 1
    return coarsen(cloud, -(-longest // _MAX_VOXELS))


def draw_sheet(
    views: list[np.ndarray],
    text: str,
    silhouette: Callable[[int], np.ndarray],
    rig: CameraRig,
    frame: Frame,
) -> np.ndarray:
    """Draw (h, w, 3) uint8 BGR: `views` side by side under `text`, above pictures of the frame.

    The outline of `silhouette(view)`, (h, w) bool, is drawn into the pictures.
    """
    above = np.hstack(views)
    text = escape_unprintable(text)  # OpenCV crashes on text that is not UTF-8
    cv2.putText(above, text, (14, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.55, _INK, 1, cv2.LINE_AA)
    return np.vstack([above, _picture_row(silhouette, rig, frame, above.shape[1])])


def draw_views(
    points: np.ndarray, normals: np.ndarray, colours: np.ndarray | None, width: float
) -> list[np.ndarray]:
    """Draw orthographic views (h, w, 3) uint8 BGR from all sides of a surface, see
    `shade_points`."""
    ends = points if len(points) else np.zeros((1, 3))
    views = [View.fit(ends, 2 * width, azimuth, up, PANEL) for azimuth, up in VIEWS]
    return [shade_points(points, normals, colours, width, view, PANEL) for view in views]


def shade_points(
    points: np.ndarray,
    normals: np.ndarray,
    colours: np.ndarray | None,
    width: float,
    view: View,
    size: tuple[int, int],
) -> np.ndarray:
    """Draw a surface as `view` shows it, `size` = (width, height) px: points (N, 3) m with unit
    normals (N, 3) and colours (N, 3) uint8 RGB, or clay, splatted into a z-buffer as discs about
    `width` m wide."""
    size = (size[0] * _SUPERSAMPLING, size[1] * _SUPERSAMPLING)
    picture = np.broadcast_to(BACKDROP, (size[1], size[0], 3)).copy()
    if len(points):
        scale = view.scale * _SUPERSAMPLING
        fine = replace(view, scale=scale, middle=view.middle * _SUPERSAMPLING)
        nearest = _z_buffer(points, 0.75 * width * scale, fine, size)
        light = _light(normals @ fine.axes.T, 0.8 * width * scale, nearest)
        base = 255 * np.array(CLAY[::-1]) if colours is None else colours[nearest][..., ::-1]
        picture = np.where(nearest[..., None] >= 0, base * light[..., None], picture)
    return np.clip(scale_picture(picture, 1 / _SUPERSAMPLING), 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class View:
    """Orthographic view.

    axes: rows point right, down and away from the viewer. centre: (3,) m. scale: px per m. middle:
    (2,) px that shows the centre.
    """

    axes: np.ndarray
    centre: np.ndarray
    scale: float
    middle: np.ndarray

    @classmethod
    def fit(
        cls,
        points: np.ndarray,
        margin: float,
        azimuth: float,
        elevation: float,
        size: tuple[int, int],
    ) -> View:
        """Return the view of all `points` (N, 3) m with a margin (m) around them, in `size` px."""
        a, e = np.radians([azimuth, elevation])
        away = -np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        right = np.array([-np.sin(a), np.cos(a), 0.0])
        axes = np.stack([right, np.cross(away, right), away])
        low, high = points.min(0), points.max(0)
        # One scale for all azimuths: that of the box rotated about the vertical.
        across = float(np.linalg.norm((high - low)[:2]))
        tall = float(high[2] - low[2]) * np.cos(e) + across * np.sin(e)
        extent = np.array([across, tall]) + 2 * margin
        scale = 0.86 * float(np.min(np.array(size) / extent))
        return cls(axes, (low + high) / 2, scale, np.array(size) * [0.5, 0.52])

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        turned = (points - self.centre) @ self.axes.T
        return turned[:, :2] * self.scale + self.middle, turned[:, 2]


def _z_buffer(points: np.ndarray, radius: float, view: View, size: tuple[int, int]) -> np.ndarray:
    """Return (h, w): the index of the point, a disc of `radius` px, nearest to the viewer, or
    -1."""
    pixels, depth = view.project(points)
    order = np.argsort(-depth, kind="stable")  # far to near: the nearest is written last
    reach = np.arange(-int(np.ceil(radius)), int(np.ceil(radius)) + 1)
    dy, dx = np.meshgrid(reach, reach, indexing="ij")
    disc = dx**2 + dy**2 <= radius**2 + 1
    corner = np.rint(pixels[order]).astype(int)
    column = corner[:, :1] + dx[disc]
    row = corner[:, 1:] + dy[disc]
    inside = (column >= 0) & (row >= 0) & (column < size[0]) & (row < size[1])
    nearest = np.full((size[1], size[0]), -1)
    nearest[row[inside], column[inside]] = np.broadcast_to(order[:, None], row.shape)[inside]
    return nearest


def _light(normals: np.ndarray, blur: float, nearest: np.ndarray) -> np.ndarray:
    """Return the brightness (h, w) of the visible points, of which `normals` are along the view's
    axes: a key light shines from the viewer's upper left, a weaker one from the right, and ambient
    light from everywhere. Normals are smoothed over `blur` px, which hides the steps of voxels."""
    field: np.ndarray = np.where(nearest[..., None] >= 0, normals[nearest], 0).astype(np.float32)
    field = np.asarray(cv2.GaussianBlur(field, (0, 0), max(1.0, blur)))
    field /= np.maximum(np.linalg.norm(field, axis=-1, keepdims=True), 1e-6)
    key = np.clip(field @ _unit(-0.5, -0.6, -0.65), 0, None)
    fill = np.clip(field @ _unit(0.8, -0.1, -0.5), 0, None)
    return 0.34 + 0.66 * key + 0.16 * fill


def draw_outline(picture: np.ndarray, silhouette: np.ndarray) -> np.ndarray:
    """Draw the outline of `silhouette` (h, w) bool on a copy of `picture` (h, w, 3)."""
    contours, _ = cv2.findContours(
        silhouette.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE
    )
    drawn = picture.copy()
    width = max(1, round(picture.shape[1] / 400))
    cv2.drawContours(drawn, contours, -1, _OUTLINE, width, cv2.LINE_AA)
    return drawn


def crop_view(frame: Frame, view: int, camera: Camera) -> np.ndarray:
    """Return one view's picture (h, w, 3) uint8 BGR without the rig's padding.

    Without a picture, returns the darkened mask.
    """
    width, height = camera.size
    if frame.images is not None:
        return frame.images[view, :height, :width]
    if frame.masks is None:
        return np.zeros((height, width, 3), np.uint8)
    grey = (frame.masks[view, :height, :width] * _MASK_GREY).astype(np.uint8)
    return cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)


def _picture_row(
    silhouette: Callable[[int], np.ndarray], rig: CameraRig, frame: Frame, width: int
) -> np.ndarray:
    """Draw up to six of the frame's pictures with an outline, filling `width` px."""
    chosen, panels = pick_evenly(len(rig), 6).tolist(), []
    for view in chosen:
        panel = draw_outline(crop_view(frame, view, rig[view]), silhouette(view))
        cell, (columns, rows) = width // len(chosen), rig[view].size
        size = cell, round(cell * rows / columns)
        panel = cv2.resize(panel, size, interpolation=cv2.INTER_AREA)
        panels.append(label_picture(panel, rig[view].name))
    row = tile_pictures([panels], BACKDROP)
    return np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0)), mode="edge")


def label_picture(picture: np.ndarray, name: str) -> np.ndarray:
    """Write a camera's name into the corner of its picture (h, w, 3) uint8; return the picture."""
    size = max(0.4, max(picture.shape[:2]) / 800)
    place, pen = (round(10 * size), round(36 * size)), max(1, round(size))
    style = cv2.FONT_HERSHEY_SIMPLEX, size
    (length, _), _ = cv2.getTextSize(name, *style, pen)
    strip = picture[: round(50 * size), : 2 * place[0] + length]
    text = np.zeros(strip.shape[:2], np.uint8)
    cv2.putText(text, name, place, *style, 255, pen, cv2.LINE_AA)
    # Not by a thicker pen: OpenCV 5 spaces its letters wider.
    halo: np.ndarray = cv2.dilate(text, np.ones((3, 3), np.uint8), iterations=pen)
    strip[:] = np.maximum(strip * (1 - halo / 255)[..., None], text[..., None])
    return picture


def tile_pictures(rows: list[list[np.ndarray]], ground: np.ndarray | int = 0) -> np.ndarray:
    """Return pictures (h, w, 3) uint8 in rows, each at the upper left of a cell as large as the
    largest of its row and column, on a `ground` of one colour."""
    bottoms = np.cumsum([max(picture.shape[0] for picture in row) for row in rows])
    columns = zip_longest(*rows, fillvalue=np.zeros((0, 0)))
    rights = np.cumsum([max(picture.shape[1] for picture in column) for column in columns])
    whole = np.zeros((bottoms[-1], rights[-1], 3), np.uint8)
    whole[:] = ground
    for row, top in zip(rows, (0, *bottoms), strict=False):
        for picture, left in zip(row, (0, *rights), strict=False):
            whole[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
    return whole


def _unit(x: float, y: float, z: float) -> np.ndarray:
    vector = np.array([x, y, z], np.float32)
    return vector / np.float32(np.linalg.norm(vector))


def _length(metres: float) -> str:
    return f"{metres * 100:.3g} cm" if metres >= 0.01 else f"{metres * 1000:.3g} mm"
