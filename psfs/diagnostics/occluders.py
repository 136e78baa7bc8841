"""Detection of furniture that hides people from a camera: `find_hidden_pixels(session)`.

Guan, Franco & Pollefeys 2007 infer occluders from silhouettes: if one camera denies a person that
the others see, something may stand before the person. Denial alone is weak evidence, since a hull
of few cameras is larger than the person. But if what is there is carved away, foreground in the
other cameras is left that no voxel explains. Where three or more cameras agree on such a place, it
is hidden from the camera that denies it. Consistent silhouettes leave no foreground unexplained, so
clean footage has no hidden pixels.
"""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np

from cl import InputError
from psfs.backend import make_evidence_pipeline
from psfs.cameras.camera import Camera, CameraRig
from psfs.common.numbers import pick_evenly
from psfs.common.progress import map_in_threads
from psfs.diagnostics.small_views import LARGE_SIDE, Shrink, compute_ahead
from psfs.session import Session
from psfs.silhouettes.config import SilhouetteConfig
from psfs.volume import find_volume
from psfs.voxels.config import OccupancyConfig
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.occupied_box import finest_pixel

#: Examined frames, spread over the sequence.
_SAMPLES = 64
#: Least number of cameras that must show unexplained foreground (two find specks in clean footage),
#: and most cameras that are hidden from the same place at once.
_AGREEING, _DENYING = 3, 2
#: Least number of frames in which a pixel must contradict the other cameras, and least share of
#: those in which it shows the person or contradicts; least ratio of a camera's pixels that show the
#: person to those that contradict, below which it has another fault.
_LEAST_FRAMES, _LEAST_SHARE, _LEAST_CONFIRMED = 2, 0.1, 0.5
#: Width of the holes that are filled, px; number of pixels below which a region is noise.
_GAP, _SPECK = 13, 300
#: Distance from explained pixels within which foreground counts as explained, too, px.
_MARGIN = 3
#: Greatest number of voxels of the grid around the person.
_VOXELS = 600_000
#: Voxels of the fine grid along each side of one of the coarse grid.
_FINE = 2
#: Share of its size by which the box of the visible person is enlarged: legs may be hidden in all
#: frames.
_ENLARGED = 0.15


def find_hidden_pixels(session: Session) -> np.ndarray | None:
    """Return (V, H, W) bool: the pixels of each camera where furniture hides what is behind it.

    None if there are none, or too few cameras to decide.
    """
    rig, sequence = session.rig, session.sequence
    if len(rig) <= _AGREEING:
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
    try:
        volume = find_volume(session)
    except InputError:  # which the stages that need a volume report
        return None
    low, high = volume.low, volume.high
    if sequence.volume is None:
        margin = _ENLARGED * (high - low)
        low, high = low - margin, high + margin
    small = find_hidden_in_box(shrink.small, evidence, low, high)
    if small is None:
        return None
    return np.stack([_enlarge(own, (rig.width, rig.height)) for own in small])


def find_hidden_in_box(
    rig: CameraRig,
    evidence: list[np.ndarray],
    low: np.ndarray,
    high: np.ndarray,
    voxels: int = _VOXELS,
    margin: int = _MARGIN,
) -> np.ndarray | None:
    """Return (V, H, W) bool: the hidden pixels, from the evidence maps (V, H, W) int8 of some
    frames.

    The people are within the box from `low` (3,) to `high` (3,) m, of so many voxels at most.
    margin: px around explained pixels that are explained, too. None if nothing is hidden.
    """
    counter = _HiddenPixelCounter(rig, low, high, (voxels, margin), evidence)
    for confirmed, denied in map_in_threads(counter.count, range(len(evidence))):
        counter.confirmed += confirmed
        counter.denied += denied
    hidden = counter.find_hidden()
    return hidden if hidden.any() else None


class _HiddenPixelCounter:
    """Counts, over all frames, of how often each pixel denied or confirmed what the other cameras
    see.

    A coarse grid finds the few places where a person may be; a fine grid resolves them. evidence:
    (V, H, W) int8 of each frame.
    """

    def __init__(
        self,
        rig: CameraRig,
        low: np.ndarray,
        high: np.ndarray,
        limits: tuple[int, int],
        evidence: list[np.ndarray],
    ) -> None:
        self.rig, self._evidence = rig, evidence
        voxels, self._margin = limits
        edge = float(np.cbrt(np.prod(high - low) / voxels))
        edge = max(edge, finest_pixel(rig, VoxelGrid.covering(low, high, edge)))
        coarse = VoxelGrid.covering(low, high, _FINE * edge)
        distances = np.linalg.norm(rig.centres - (low + high) / 2, axis=1)
        self._widths = [
            max(1, int(np.ceil(edge * camera.K[0, 0] / distance)))
            for camera, distance in zip(rig, distances, strict=True)
        ]
        candidates = self._find_candidates(coarse)
        used = np.unique(np.concatenate(candidates))
        self._voxels = [_find_children(np.searchsorted(used, own)) for own in candidates]
        centres = _divide(coarse, used)
        self._pixels = np.stack([self._project_to_indices(centres, camera) for camera in rig])
        self._seen = (self._pixels >= 0).sum(0) >= OccupancyConfig().seeing_cameras(len(rig))
        size = (len(rig), rig.height, rig.width)
        self.denied, self.confirmed = np.zeros(size, np.int16), np.zeros(size, np.int16)

    def _find_candidates(self, coarse: VoxelGrid) -> list[np.ndarray]:
        """Return, for each frame, the coarse voxels (N,) where enough cameras, or nearly enough,
        show foreground."""
        centres, views = coarse.centres(), range(len(self.rig))
        places = list(map_in_threads(partial(self._project_to_indices, centres), self.rig.cameras))
        squares = [np.ones((2 * _FINE * width + 1,) * 2, np.uint8) for width in self._widths]

        def find(evidence: np.ndarray) -> np.ndarray:
            shown = _bytes(evidence > 0)
            near = (_look_up(cv2.dilate(shown[v], squares[v]), places[v]) > 0 for v in views)
            return np.flatnonzero(sum(own.astype(np.int16) for own in near) >= _AGREEING)

        return list(map_in_threads(find, self._evidence))

    def _project_to_indices(self, centres: np.ndarray, camera: Camera) -> np.ndarray:
        """Return (N,) int32 flat pixel indices of the projected points; -1 outside the picture."""
        inside, row, column, _ = camera.look_up(centres)
        places = np.full(len(centres), -1, np.int32)
        places[inside] = row * self.rig.width + column
        return places

    def count(self, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the pixels (V, H, W) bool that confirm, in a frame, what the other cameras see,
        and those that deny it."""
        evidence, voxels = self._evidence[frame], self._voxels[frame]
        shown, pixels = evidence > 0, self._pixels[:, voxels]
        counts = np.stack([_look_up(own, at) for own, at in zip(evidence, pixels, strict=True)])
        occupied = (counts.sum(0, dtype=np.int16) > 0) & self._seen[voxels]
        explained = np.stack(
            [self._covered_pixels(v, pixels[v][occupied], self._margin) for v in range(len(shown))]
        )
        denied = np.zeros_like(shown)
        lonely = [cv2.erode(own, np.ones((3, 3), np.uint8)) for own in _bytes(shown & ~explained)]
        if sum(own.any() for own in lonely) < _AGREEING:
            return shown & explained, denied
        wanted = [_look_up(own, at) > 0 for own, at in zip(lonely, pixels, strict=True)]
        against = counts < 0
        n_against, n_for = against.sum(0), (counts > 0).sum(0)
        amiss = (np.sum(wanted, 0) >= _AGREEING) & (n_against <= _DENYING)
        amiss &= ~occupied & (n_for > n_against)
        for view, own in enumerate(shown):
            denied[view] = self._covered_pixels(view, pixels[view][amiss & against[view]], 0) & ~own
        return shown & explained, denied

    def _covered_pixels(self, view: int, pixels: np.ndarray, margin: int) -> np.ndarray:
        """Return (H, W) bool: the pixels that voxels projected to `pixels` cover, with a margin,
        px."""
        maps = np.zeros((self.rig.height, self.rig.width), np.uint8)
        maps.ravel()[pixels[pixels >= 0]] = 1
        size = self._widths[view] + 2 * margin
        return cv2.dilate(maps, np.ones((size, size), np.uint8)) > 0

    def find_hidden(self) -> np.ndarray:
        """Return (V, H, W) bool: the pixels that deny in enough frames, with holes filled and
        specks removed."""
        enough = self.denied >= np.maximum(
            _LEAST_FRAMES, _LEAST_SHARE * (self.denied + self.confirmed)
        )
        sums = self.confirmed.sum((1, 2), dtype=int), self.denied.sum((1, 2), dtype=int)
        enough &= (sums[0] >= _LEAST_CONFIRMED * sums[1])[:, None, None]
        square = np.ones((_GAP, _GAP), np.uint8)
        closed = [cv2.morphologyEx(own, cv2.MORPH_CLOSE, square) for own in _bytes(enough)]
        return np.stack([_without_specks(own, _SPECK) for own in closed])


def _divide(coarse: VoxelGrid, voxels: np.ndarray) -> np.ndarray:
    """Return the centres (N * _FINE**3, 3), m, of the fine voxels in the coarse ones (N,)."""
    offsets = (np.arange(_FINE) + 0.5) / _FINE - 0.5
    around = np.stack(np.meshgrid(*3 * [offsets], indexing="ij"), -1).reshape(-1, 3)
    fine = coarse.centres(voxels)[:, None] + coarse.voxel_size * around
    return fine.reshape(-1, 3)


def _find_children(voxels: np.ndarray) -> np.ndarray:
    """Return the places (N * _FINE**3,) in the order of `_divide` of the coarse voxels' parts."""
    return (voxels[:, None] * _FINE**3 + np.arange(_FINE**3)).ravel()


def _look_up(maps: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Return the values (N,) of a map (H, W) at flat indices; 0 at the index -1."""
    return np.append(maps.ravel(), maps.dtype.type(0))[places]


def _bytes(maps: np.ndarray) -> np.ndarray:
    return maps.view(np.uint8)


def _without_specks(region: np.ndarray, least: int) -> np.ndarray:
    """Return (H, W) bool: the parts of a region (H, W) uint8 with `least` pixels or more."""
    count, labels, facts, _ = cv2.connectedComponentsWithStats(region, connectivity=8)
    kept = facts[:count, cv2.CC_STAT_AREA] >= least
    kept[0] = False
    return kept[labels]


def _enlarge(region: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    if region.shape == size[::-1]:
        return region
    return cv2.resize(region.view(np.uint8), size, interpolation=cv2.INTER_NEAREST).view(bool)
