"""Detection of furniture that hides people from a camera: `find_hidden_pixels(session)`.

Guan, Franco & Pollefeys 2007 infer occluders from silhouettes: if one camera denies a person that
the others see, something may stand before the person. Denial alone is weak evidence, since a hull
of few cameras is larger than the person. But if what is there is carved away, foreground in the
other cameras is left that no voxel explains. Where two or more cameras agree on such a place, it
is hidden from the camera that denies it. Consistent silhouettes leave no foreground unexplained, so
clean footage has no hidden pixels.
"""

from __future__ import annotations

from functools import partial, reduce

import cv2
import numpy as np

from cl import InputError
from psfs.backend import make_evidence_pipeline
from psfs.cameras.camera import CameraRig
from psfs.common.numbers import pick_evenly
from psfs.common.progress import map_in_threads
from psfs.common.regions import keep_large_regions
from psfs.diagnostics.small_views import LARGE_SIDE, Shrink, compute_ahead
from psfs.session import Session
from psfs.silhouettes.config import SilhouetteConfig
from psfs.volume import find_volume
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.occupied_box import CoarseSpace, finest_pixel, look_up

#: Examined frames, spread over the sequence.
_SAMPLES = 64
#: Least number of frames in which a pixel must contradict the other cameras.
_LEAST_FRAMES = 2
#: Width of the holes that are filled, px; number of pixels below which a region is noise.
_GAP, _SPECK = 13, 300
#: Distance from explained pixels within which foreground counts as explained, too, px.
_MARGIN = 3
#: Greatest number of voxels of the grid around the person.
_VOXELS = 600_000


#: Searches for hidden pixels: least number of cameras that show unexplained foreground; greatest
#: number of those that are hidden from the same place; and least share of the frames in which a
#: pixel contradicts the other cameras among those in which it shows the person or contradicts. The
#: strongest evidence first, since what it explains is not left for the next: two cameras find
#: specks in clean footage, but not where the person hardly ever appears.
_SEARCHES = ((3, 1, 0.1), (3, 2, 0.1), (2, 2, 0.9))


def find_hidden_pixels(session: Session) -> np.ndarray | None:
    """Return (V, H, W) bool: the pixels of each camera where furniture hides what is behind it.

    None if there are none, or too few cameras to decide.
    """
    rig, sequence = session.rig, session.sequence
    if len(rig) <= max(agreeing for agreeing, _, _ in _SEARCHES):
        return None
    shrink = Shrink(rig, rig.factor_within(LARGE_SIDE))
    background = shrink.background(session.background)
    begin = make_evidence_pipeline(
        session.device, shrink.small, background, SilhouetteConfig().without_memory()
    )
    picked = pick_evenly(len(sequence), _SAMPLES).tolist()
    with sequence.reader(learning=False) as read:
        frames = shrink.frames(map(read, picked))
        evidence = [counts.copy() for _, counts in compute_ahead(frames, begin)]
    try:  # the volume of all frames: outside the selection's, foreground would stay unexplained
        volume = find_volume(session.with_frames(range(len(sequence))))
    except InputError:  # which the stages that need a volume report
        return None
    small = find_hidden_in_box(shrink.small, evidence, volume.low, volume.high, _VOXELS)
    if small is None:
        return None
    size = rig.width, rig.height
    return np.stack(
        [cv2.resize(own, size, interpolation=cv2.INTER_NEAREST) for own in _bytes(small)]
    ).view(bool)


def find_hidden_in_box(
    rig: CameraRig,
    evidence: list[np.ndarray],
    low: np.ndarray,
    high: np.ndarray,
    voxels: int,
    margin: int = _MARGIN,
) -> np.ndarray | None:
    """Return (V, H, W) bool: the hidden pixels, from the evidence maps (V, H, W) int8 of some
    frames.

    The people are within the box from `low` (3,) to `high` (3,) m, of so many voxels at most.
    margin: px around explained pixels that are explained, too. None if nothing is hidden.
    """
    edge = float(np.cbrt(np.prod(high - low) / voxels))
    edge = max(edge, finest_pixel(rig, VoxelGrid.covering(low, high, edge)))
    grid = VoxelGrid.covering(low, high, edge)
    space = CoarseSpace(rig, grid, OccupancyConfig().seeing_cameras(len(rig)))
    fewest = min(agreeing for agreeing, _, _ in _SEARCHES)
    space.keep(_count(reduce(np.maximum, evidence) > 0, space.pixels) >= fewest)
    hidden = np.zeros_like(evidence[0], bool)
    seeing = map_in_threads(lambda maps: _count(maps > 0, space.pixels), evidence)
    frames = list(zip(evidence, seeing, strict=True))
    for agreeing, denying, least_share in _SEARCHES:
        denied, confirmed = np.zeros((2, *hidden.shape), np.uint8)
        known = hidden if hidden.any() else None
        judge = partial(_judge, space, margin, agreeing, denying, known)
        for confirms, denies in map_in_threads(judge, frames):
            confirmed += _bytes(confirms)
            if denies is not None:
                denied += _bytes(denies)
        enough = denied >= np.maximum(_LEAST_FRAMES, least_share * (denied + confirmed))
        enough &= confirmed.any((1, 2))[:, None, None]  # else the camera shows nobody
        square = np.ones((_GAP, _GAP), np.uint8)
        closed = [cv2.morphologyEx(own, cv2.MORPH_CLOSE, square) for own in _bytes(enough)]
        hidden |= np.stack([keep_large_regions(own > 0, least=_SPECK) for own in closed])
    return hidden if hidden.any() else None


def _judge(
    space: CoarseSpace,
    margin: int,
    agreeing: int,
    denying: int,
    hidden: np.ndarray | None,
    frame: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the pixels (V, H, W) bool that confirm, in a frame, what the other cameras see in the
    voxels of a space, and those that deny it, None without any. margin: as of `find_hidden_in_box`.
    agreeing, denying: see `_SEARCHES`. hidden: (V, H, W) bool, pixels known to be hidden already,
    which deny nothing. frame: its evidence maps, and the number of cameras that show foreground in
    each voxel."""
    evidence, seeing = frame
    shown = evidence > 0
    if hidden is not None:
        evidence = np.where(hidden & ~shown, np.int8(0), evidence)
    rows = np.flatnonzero(seeing >= agreeing)
    pixels = space.pixels[:, rows]
    counts = look_up(evidence, pixels)
    occupied, against = counts.sum(0, dtype=np.int16) > 0, counts < 0
    explained = np.stack(
        [space.cover(view, rows[occupied], 2 * margin) for view in range(len(shown))]
    )
    rest, square = shown & ~explained, np.ones((3, 3), np.uint8)
    lonely = np.stack([cv2.erode(own, square) for own in _bytes(rest)]) > 0
    denied = None
    if lonely.any((1, 2)).sum() >= agreeing:
        denied = np.zeros_like(shown)
        n_against, n_for = against.sum(0), (counts > 0).sum(0)
        amiss = (_count(lonely, pixels) >= agreeing) & (n_against <= denying)
        amiss &= ~occupied & (n_for >= n_against)
        for view, own in enumerate(shown):
            denied[view] = space.cover(view, rows[amiss & against[view]]) & ~own
    return shown & explained, denied


def _count(maps: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Return how many of the maps (V, H, W) bool are true at flat indices (V, N)."""
    return look_up(maps, pixels).sum(0, dtype=np.int8)


def _bytes(maps: np.ndarray) -> np.ndarray:
    return maps.view(np.uint8)
