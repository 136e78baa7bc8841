"""One session for each of several people, in which the others do not count.

All people are reconstructed together. Each surface voxel belongs to the person whose coarse voxels
are nearest, and a pixel of the foreground to the people whose voxels cover it, or to the nearest. A
person's masks are the evidence in their own pixels, nothing ("unknown") where somebody else stands
before them, and background in the pixels of the others. If two people touch, what lies between
their trunks may be an arm of either and belongs to both.
"""

from __future__ import annotations

import tempfile
import threading
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np

from psfs.cameras.camera import Camera, CameraRig
from psfs.cameras.footprints import voxel_footprints
from psfs.common.numbers import select_span
from psfs.footage.frame import Space
from psfs.people.agreement import Disagreement, measure_disagreement
from psfs.people.contact import ARM_REACH, Pair, SplitCloud, find_contacts, split_cloud
from psfs.people.ghosts import Ghosts
from psfs.people.people import People
from psfs.session import Session, SessionSettings
from psfs.silhouettes.hidden import UNKNOWN, UNKNOWN_MASK
from psfs.volume import Volume, automatic_grid, find_volume
from psfs.voxels.config import ReconstructionConfig

#: Depth where nothing is drawn, m.
FAR = 1e6
#: Room around the voxels of all people, and of one, m.
MARGIN = 0.2
#: Depth by which another one must be nearer to the camera to hide a person, m.
_BEFORE = 0.05


def separate(
    session: Session, people: People, progress: Callable[[], object] | None = None
) -> list[Session]:
    """Return a session for each of `people`, over the frames from the first to the last that show
    them. progress: called after each frame."""
    everybody = join_session(session, people)
    contacts = find_contacts(people, session.rate)
    store, volumes, colours = _divide(everybody, people, contacts, progress)
    spaces = _find_spaces(session.rig, people, contacts, colours)
    return [
        _make_session(session, people, number, box, store, spaces)
        for number, box in enumerate(volumes)
    ]


def _divide(
    everybody: Session,
    people: People,
    contacts: dict[int, list[Pair]],
    progress: Callable[[], object] | None,
) -> tuple[MaskStore, list[Volume], dict[tuple[int, int], Disagreement]]:
    """Return the masks and the volume of each of `people`, and by person and frame how far the
    cameras disagree on the colours of their voxels, if there are pictures."""
    rig, grid = everybody.rig, automatic_grid(everybody)
    store = MaskStore(len(rig), rig.height, rig.width)
    attribution = Attribution(rig, everybody.reconstruction)
    footprints = voxel_footprints(rig, grid.voxel_size)
    reconstruct = everybody.reconstructor(grid)
    boxes: list[list[np.ndarray]] = [[] for _ in people]
    colours: dict[tuple[int, int], Disagreement] = {}
    for frame in everybody.sequence.frames(everybody.settings.selection):
        cloud = reconstruct(frame).cloud()
        split = split_cloud(cloud, people, frame.index, contacts[frame.index])
        for box, points in zip(boxes, split.clouds, strict=False):
            if len(points):
                box.append(np.stack([points.min(0), points.max(0)]))
        if frame.images is not None and len(people) > 1:
            depths = np.stack([
                draw_depths(camera, cloud.centres, extents, frame.images.shape[1:3])
                for camera, extents in zip(rig, footprints, strict=True)
            ])  # fmt: skip
            for number, points in enumerate(split.clouds[:-1]):
                colours[number, frame.index] = measure_disagreement(
                    rig, frame.images, depths, points, grid.voxel_size
                )
        masks = attribution(reconstruct.evidence(), split, footprints)
        for number, own in enumerate(masks):
            store.add(number, frame.index, own)
        if progress is not None:
            progress()
    volumes = []
    for person, box in zip(people, boxes, strict=True):
        coarse = np.stack(replace(people, persons=(person,)).box())
        ends = np.array(box or [coarse])  # (N, 2, 3) m
        low, high = ends[:, 0].min(0), ends[:, 1].max(0)
        volumes.append(Volume(low - MARGIN, high + MARGIN))
    return store, volumes, colours


def _find_spaces(
    rig: CameraRig,
    people: People,
    contacts: dict[int, list[Pair]],
    colours: dict[tuple[int, int], Disagreement],
) -> Callable[[int, int], Space | None] | None:
    """Return where a person, by number, may be in a frame: not where ghosts are. Those who touch
    somebody may be everywhere: an arm may be in the other's space."""
    if len(people) < 2:
        return None  # nobody makes ghosts
    places = people.find_places()

    def find_space(number: int, frame: int) -> Space | None:
        if any(number in pair for pair in contacts.get(frame, ())):
            return None
        seen = colours.get((number, frame))
        return lambda points: Ghosts(rig, places, frame).find_own(number, points, seen)

    return find_space


def join_session(session: Session, people: People) -> Session:
    """Return a session whose volume holds everybody, with some room around them."""
    joint = Session(session.sequence, session.device, session.settings)
    joint.replace_result(find_volume, Volume(*people.box(MARGIN)))
    return joint


def _make_session(
    session: Session,
    people: People,
    number: int,
    volume: Volume,
    store: MaskStore,
    spaces: Callable[[int, int], Space | None] | None,
) -> Session:
    """Return the session of one person. store: their masks."""
    selection = select_span(people.persons[number].frames, session.frames.step)
    # The person's own masks hold ghosts that all cameras see before or behind people.
    space_of = None if spaces is None else partial(spaces, number)
    rig, views = with_hidden_maps(session.rig), session.sequence
    sequence = views.with_masks(partial(store.get, number), space_of).with_rig(rig)
    changes = {
        "silhouette": {"evidence": {"unknown_mask": UNKNOWN_MASK}},
        "occupancy": {"min_cameras": 1},  # what others hide is not seen, yet may be occupied
    }
    settings = SessionSettings(
        session.reconstruction.overlay(changes),
        selection,
        session.settings.voxel_size,
    )
    own = Session(sequence, session.device, settings)
    own.replace_result(find_volume, volume)
    return own


def with_hidden_maps(rig: CameraRig) -> CameraRig:
    """Return the rig with a map of hidden pixels in every camera, empty where it had none: its
    evidence may then be unknown."""
    return CameraRig(
        tuple(
            camera if camera.hidden is not None
            else replace(camera, hidden=np.zeros(camera.size[::-1], bool))
            for camera in rig
        )
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Attribution:
    """Assignment of evidence maps (V, H, W) to people."""

    rig: CameraRig
    config: ReconstructionConfig

    def __call__(
        self, evidence: np.ndarray, split: SplitCloud, footprints: np.ndarray
    ) -> np.ndarray:
        """Return masks (P, V, H, W) uint8 of the people."""
        of_counts = self._tabulate_masks()
        masks = np.zeros((len(split.near), *evidence.shape), np.uint8)
        for view, counts in enumerate(evidence):
            depths, beside = self._draw_clouds(view, split.clouds, footprints, counts.shape)
            sole_depths, sole_beside = depths, beside
            if split.sole is not split.clouds:
                sole_depths, sole_beside = self._draw_clouds(
                    view, split.sole, footprints, counts.shape
                )
            plain = of_counts[counts.view(np.uint8)]
            for number, near in enumerate(split.near):
                if not len(split.clouds[number]):
                    continue
                rest = [k for k in range(len(split.clouds)) if k != number]
                mask = self._make_mask(
                    plain, counts, depths[number], sole_depths[rest].min(0), beside[number],
                    sole_beside[rest].min(0),
                )  # fmt: skip
                if len(near):
                    _, (away,) = self._draw_clouds(view, [near], footprints, counts.shape)
                    mask[(away == 0) & (mask == 0) & (counts > 0)] = UNKNOWN_MASK
                masks[number, view] = mask
        return masks

    def _draw_clouds(
        self, view: int, clouds: list[np.ndarray], footprints: np.ndarray, shape: tuple[int, ...]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return depths and distances (C, H, W) m of clouds in a camera, see `draw`."""
        drawn = [draw(self.rig[view], points, footprints[view], shape) for points in clouds]
        return np.stack([depth for depth, _ in drawn]), np.stack([away for _, away in drawn])

    def _make_mask(
        self,
        plain: np.ndarray,
        counts: np.ndarray,
        depth: np.ndarray,
        other_depth: np.ndarray,
        beside: np.ndarray,
        other_beside: np.ndarray,
    ) -> np.ndarray:
        """Return the mask (H, W) of one person in one camera."""
        mine = (beside <= other_beside) & (beside < ARM_REACH)
        mask = np.where(mine | (counts <= 0), plain, 0).astype(np.uint8)
        hidden = (beside == 0) & (other_depth < depth - _BEFORE) & (counts > 0)
        mask[hidden] = UNKNOWN_MASK
        return mask

    def _tabulate_masks(self) -> np.ndarray:
        """Return the mask (256,) uint8 for each count of evidence, by its bits."""
        counts = np.arange(256).astype(np.uint8).view(np.int8)
        masks = np.rint(255 * self.config.silhouette.evidence.likelihood(counts)).astype(int)
        masks = np.where((masks == UNKNOWN_MASK) & (counts != 0), UNKNOWN_MASK + 1, masks)
        masks = np.where(masks == UNKNOWN_MASK, UNKNOWN_MASK - 1, masks)
        masks[counts == UNKNOWN] = UNKNOWN_MASK
        return np.clip(masks, 0, 255).astype(np.uint8)


def draw(
    camera: Camera, points: np.ndarray, footprint: np.ndarray, shape: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Draw voxels with centres (N, 3) m: return their depths, see `draw_depths`, and the distance
    (H, W) from each pixel to their silhouette, in metres at their median depth; `FAR` if the camera
    sees none of them."""
    depths, middle = _draw(camera, points, footprint, shape)
    if middle is None:
        return depths, np.full(shape, FAR, np.float32)
    free = (depths >= FAR).astype(np.uint8)
    distance = cv2.distanceTransform(free, cv2.DIST_L2, 3)
    return depths, distance * np.float32(middle / camera.K[0, 0])


def draw_depths(
    camera: Camera, points: np.ndarray, footprint: np.ndarray, shape: tuple[int, ...]
) -> np.ndarray:
    """Return the depth (H, W) m of the nearest of the voxels with centres (N, 3) m in each pixel,
    `FAR` where there is none."""
    return _draw(camera, points, footprint, shape)[0]


def _draw(
    camera: Camera, points: np.ndarray, footprint: np.ndarray, shape: tuple[int, ...]
) -> tuple[np.ndarray, float | None]:
    """Return the depths of `draw_depths`, and the median depth of the voxels that the camera sees,
    None if it sees none."""
    depths = np.full(shape, FAR, np.float32)  # OpenCV erodes no infinite values
    inside, row, column, depth = camera.look_up(points)
    if not inside.any():
        return depths, None
    order = np.argsort(-depth, kind="stable")  # the nearest is written last
    depths[row[order], column[order]] = depth[order]
    middle = float(np.median(depth))
    width = max(3, 2 * int(np.ceil(float(footprint.max()) / middle)) + 1)
    return np.asarray(cv2.erode(depths, np.ones((width, width), np.uint8))), middle


class MaskStore:
    """Masks (V, H, W) uint8 of people and frames, compressed in a temporary file."""

    def __init__(self, *shape: int) -> None:
        self._shape = shape
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 - as long as the store
        self._places: dict[tuple[int, int], tuple[int, int]] = {}
        self._lock = threading.Lock()  # frames are read ahead in other threads

    def add(self, number: int, index: int, masks: np.ndarray) -> None:
        """Keep the masks of a person in a frame."""
        packed = zlib.compress(masks.tobytes(), 1)
        self._places[number, index] = self._file.seek(0, 2), len(packed)
        self._file.write(packed)

    def get(self, number: int, index: int) -> np.ndarray:
        """Return the masks of a person in a frame, black in one that was not kept."""
        if (number, index) not in self._places:
            return np.zeros(self._shape, np.uint8)
        place, length = self._places[number, index]
        with self._lock:
            self._file.seek(place)
            packed = self._file.read(length)
        return np.frombuffer(zlib.decompress(packed), np.uint8).reshape(self._shape)
