"""The silhouettes that a sequence is reconstructed from and its voxel clouds, their agreement with
true masks, and mosaics. Clouds are compared with those that the same grid would give if the true
masks were the silhouettes."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from collections.abc import Sequence as Items
from dataclasses import dataclass, fields

import cv2
import numpy as np
import scipy

from cl import InputError
from psfs.cameras.camera import Camera, CameraRig
from psfs.common.numbers import mean_known
from psfs.common.pictures import read_picture
from psfs.common.regions import bounding_box, iou
from psfs.diagnostics.reprojection_iou import volume_region
from psfs.mesh.marching_cubes import fill_cloud
from psfs.output.preview import crop_view, label_picture, tile_pictures
from psfs.sequence import Frame, Sequence
from psfs.session import Session
from psfs.volume import automatic_grid
from psfs.voxels.clouds import remove_debris
from psfs.voxels.grid import VoxelCloud, VoxelGrid

CLOUD_DEFINITION = (
    "iou: of the true masks with the cloud, whose surface voxels are drawn as discs of half their "
    "projected size; ceiling: the same for all voxels of the grid that lie in every true mask; "
    "ghosts: share of the cloud's voxels that are none of those, nor neighbours of one; volume: "
    "iou of the voxels within the cloud's surface with those that lie in every true mask, of those "
    "that all cameras with a true mask see"
)


@dataclass(frozen=True)
class CloudScore:
    """The scores of a frame's cloud, means over the cameras with a true mask, as `CLOUD_DEFINITION`
    says. NaN where there is nothing to compare."""

    iou: float
    ceiling: float
    ghosts: float
    volume: float


def score_cloud(rig: CameraRig, cloud: VoxelCloud, truth: Items[np.ndarray | None]) -> CloudScore:
    """Return the scores of a frame's cloud, given the true masks (H, W) bool of the cameras."""
    seen = [(camera, mask) for camera, mask in zip(rig, truth, strict=True) if mask is not None]
    grid = cloud.grid
    hull = _carve(seen, grid)
    ours, best = (
        [
            iou(draw_voxels(camera, points, grid.voxel_size, mask.shape), mask)
            for camera, mask in seen
        ]
        for points in (cloud.centres, grid.centres(hull))
    )
    in_hull = np.zeros(grid.shape, bool)
    in_hull.ravel()[hull] = True
    hull_and_rim = scipy.ndimage.binary_dilation(in_hull, np.ones((3, 3, 3)))
    ghosts = float(1 - hull_and_rim.ravel()[cloud.indices].mean()) if len(cloud) else float("nan")
    return CloudScore(mean_known(ours), mean_known(best), ghosts, _volume_iou(seen, cloud, in_hull))


def mean_scores(scores: Items[CloudScore]) -> dict[str, float | None]:
    """Return the mean of each score over frames, None where it is unknown."""
    names = [field.name for field in fields(CloudScore)]
    means = {name: mean_known([getattr(score, name) for score in scores]) for name in names}
    return {name: None if np.isnan(mean) else mean for name, mean in means.items()}


def draw_voxels(
    camera: Camera, points: np.ndarray, edge: float, shape: tuple[int, ...]
) -> np.ndarray:
    """Return the pixels `shape` (H, W) bool that the voxels cover, of `edge` m around `points` (N,
    3): each a disc of half its projected size."""
    _, row, column, depth = camera.look_up(points)
    radii = np.maximum(1, np.round(0.5 * edge * camera.K[0, 0] / depth)).astype(int)
    drawn = np.zeros(shape, bool)
    for radius in np.unique(radii):
        pixels = np.zeros(shape, np.uint8)
        pixels[row[radii == radius], column[radii == radius]] = 1
        disc = np.zeros((2 * radius + 1,) * 2, np.uint8)
        cv2.circle(disc, (int(radius), int(radius)), int(radius), 1, -1)
        drawn |= cv2.dilate(pixels, disc) > 0
    return drawn


def _carve(seen: Items[tuple[Camera, np.ndarray]], grid: VoxelGrid) -> np.ndarray:
    """Return the flat indices (N,) of the voxels that lie in every mask whose picture shows
    them."""
    voxels = np.arange(grid.size)
    for camera, mask in seen:
        inside, row, column, _ = camera.look_up(grid.centres(voxels))
        inside_masks = ~inside
        inside_masks[inside] = mask[row, column]
        voxels = voxels[inside_masks]
    return voxels


def _volume_iou(
    seen: Items[tuple[Camera, np.ndarray]], cloud: VoxelCloud, in_hull: np.ndarray
) -> float:
    """Return the IoU of the voxels in the cloud's surface with the hull (nx, ny, nz) bool, among
    those that all cameras see; NaN if there is nothing to compare."""
    if not seen:
        return float("nan")
    filled = fill_cloud(cloud, cloud.grid)
    either = np.flatnonzero(filled | in_hull)
    centres = cloud.grid.centres(either)
    visible = either[np.all([camera.look_up(centres)[0] for camera, _ in seen], axis=0)]
    return iou(filled.ravel()[visible], in_hull.ravel()[visible]) if len(visible) else float("nan")


#: Folder of a sequence with true silhouettes, <camera>_<frame:06d>.png. For scoring only.
TRUE_MASKS = "truth_masks"

DEFINITION = (
    "silhouette: the pixels whose likelihood is above 0.5, within the projection of the "
    "reconstruction volume, as the reconstruction sees them after all frames before; iou: with the "
    "true mask; missed, extra: pixels that it lacks and has too many, as shares of the true mask; "
    "foreground: its share of the picture"
)


@dataclass(frozen=True, eq=False)
class Silhouettes:
    """The silhouettes of one frame, in all V views.

    region: (V, H, W) bool, pixels that look into the reconstruction volume. likelihood: (V, H, W)
    float64 of eq. (1)-(2) of Song et al. masks: (V, H, W) bool, the silhouettes. truth: per view
    the true mask (H, W) bool, None where there is none. scores: (V, 4) IoU, missed, extra and
    foreground as `DEFINITION` says; NaN where there is no truth, or an empty one. cloud: the
    surface voxels, without debris.
    """

    frame: Frame
    region: np.ndarray
    likelihood: np.ndarray
    masks: np.ndarray
    truth: list[np.ndarray | None]
    scores: np.ndarray
    cloud: VoxelCloud


def truth_frames(sequence: Sequence) -> list[int]:
    """Return the numbers of the frames with a true mask of at least one camera."""
    folder, names = sequence.folder / TRUE_MASKS, sequence.rig.names
    numbers = {
        int(path.stem[-6:])
        for path in folder.glob("*_[0-9][0-9][0-9][0-9][0-9][0-9].png")
        if path.stem[:-7] in names
    }
    return sorted(numbers & set(range(len(sequence))))


def true_masks(sequence: Sequence, frame: int) -> list[np.ndarray | None]:
    """Return the true mask (H, W) bool of each camera, zero padded; None if the file is missing.
    Raises InputError if it is no picture of the camera's size."""
    masks: list[np.ndarray | None] = []
    for camera in sequence.rig:
        path = sequence.folder / TRUE_MASKS / f"{camera.name}_{frame:06d}.png"
        mask, (width, height) = None, camera.size
        if path.exists():
            picture = read_picture(path, cv2.IMREAD_GRAYSCALE)
            if picture.shape != (height, width):
                size = f"{picture.shape[1]} x {picture.shape[0]} px"
                raise InputError(f"{path}: {size}; expected a mask of {width} x {height} px")
            mask = np.zeros((sequence.rig.height, sequence.rig.width), bool)
            mask[:height, :width] = picture > 127
        masks.append(mask)
    return masks


def score_silhouettes(session: Session, wanted: Collection[int]) -> Iterator[Silhouettes | None]:
    """Reconstruct the frames up to the last `wanted` one; yield the silhouettes of those wanted,
    None for the others.

    All earlier frames are reconstructed, too, since the appearance model is fitted to them. Raises
    InputError as `automatic_grid` does, and for true masks that cannot be read.
    """
    sequence, grid = session.sequence, automatic_grid(session)
    rig, within = sequence.rig, volume_region(sequence.rig, grid)
    reconstruct = session.reconstructor(grid)
    for frame in sequence.frames(slice(max(wanted) + 1)):
        voxels = reconstruct(frame)
        if frame.index not in wanted:
            yield None
            continue
        evidence = reconstruct.evidence()
        masks = (evidence > 0) & within
        truth = true_masks(sequence, frame.index)
        scores = np.array([_scores(*view) for view in zip(rig, masks, truth, strict=True)])
        likelihood = session.reconstruction.silhouette.evidence.likelihood(evidence)
        cloud = remove_debris(voxels.cloud())
        yield Silhouettes(frame, within, likelihood, masks, truth, scores, cloud)


def _scores(camera: Camera, mask: np.ndarray, truth: np.ndarray | None) -> list[float]:
    """Return IoU, missed, extra and foreground of one view."""
    foreground = float(mask.sum() / np.prod(camera.size))
    if truth is None or not truth.any():
        return [np.nan, np.nan, np.nan, foreground]
    whole = truth.sum()
    missed, extra = (truth & ~mask).sum() / whole, (mask & ~truth).sum() / whole
    return [iou(mask, truth), float(missed), float(extra), foreground]


#: Width and height of a panel and the gap after it, px; brightness of the picture below the
#: differences, and their colours, BGR.
_PANEL, _GAP, _DARKENED = (480, 480), 4, 0.35
_MISSED, _EXTRA = (40, 40, 255), (40, 255, 40)


def draw_mosaic(rig: CameraRig, result: Silhouettes) -> np.ndarray:
    """Draw (h, w, 3) uint8 BGR: a row per camera with the picture, the likelihood (black 0, white
    1), the silhouette and, if a true mask is known, the differences between the two."""
    return tile_pictures([_draw_row(camera, view, result) for view, camera in enumerate(rig)])


def draw_differences(picture: np.ndarray, mask: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return the darkened `picture` (h, w, 3): pixels of `truth` that `mask` (h, w) bool misses are
    red, pixels of `mask` outside `truth` are green."""
    drawn: np.ndarray = (picture * _DARKENED).astype(np.uint8)
    drawn[truth & mask] = picture[truth & mask]
    drawn[truth & ~mask] = _MISSED
    drawn[mask & ~truth] = _EXTRA
    return drawn


def _draw_row(camera: Camera, view: int, result: Silhouettes) -> list[np.ndarray]:
    """Draw one view's panels: of what looks into the volume or belongs to the true mask, if there
    is anything."""
    truth, (width, height) = result.truth[view], camera.size
    region = result.region[view] if truth is None else result.region[view] | truth
    crop = bounding_box(region) or np.s_[:height, :width]
    picture = crop_view(result.frame, view, camera)[crop]
    mask = result.masks[view][crop]
    panels = {
        f"{camera.name}, frame {result.frame.index}": picture,
        "likelihood": _grey(result.likelihood[view][crop]),
        "silhouette": _grey(mask),
    }
    if truth is not None:
        score = result.scores[view, 0]
        known = "true mask empty" if np.isnan(score) else f"IoU {score:.3f}"
        panels[f"{known}: missed red, too much green"] = draw_differences(
            picture, mask, truth[crop]
        )
    return [_fit(panel, text) for text, panel in panels.items()]


def _fit(panel: np.ndarray, text: str) -> np.ndarray:
    """Return the panel enlarged or reduced to fit into `_PANEL`, with a text."""
    scale = min(_PANEL / np.array(panel.shape[1::-1]))
    # Enlarged pixels stay square, so that each can be seen.
    how = cv2.INTER_AREA if scale < 1 else cv2.INTER_NEAREST
    sized = cv2.resize(panel, None, fx=scale, fy=scale, interpolation=how)
    return np.pad(label_picture(sized, text), ((0, _GAP), (0, _GAP), (0, 0)))


def _grey(values: np.ndarray) -> np.ndarray:
    """Return values (h, w) of 0 to 1 as a picture (h, w, 3) uint8."""
    return cv2.cvtColor(np.rint(255.0 * values).astype(np.uint8), cv2.COLOR_GRAY2BGR)
