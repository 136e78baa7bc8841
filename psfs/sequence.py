"""Synchronised, calibrated views of one scene, read from a folder."""

from __future__ import annotations

import math
import os
import pickle
from collections.abc import Callable, Collection, Generator, Iterator, Mapping
from collections.abc import Sequence as Items
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, fields
from functools import cached_property, partial
from itertools import product
from multiprocessing.pool import ThreadPool
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

from cl import InputError
from psfs.background.chroma_key import key_from_media
from psfs.background.gaussian import Background
from psfs.background.mixture import Mixture
from psfs.background.take import estimate_background_from_take
from psfs.cameras.calibration.common import LEFT_HANDED, MIRROR
from psfs.cameras.camera import CameraRig
from psfs.cameras.units import metres_per_unit, rotate_rig, rotation_to_z_up
from psfs.common.files import resolve_path
from psfs.common.ranges import check_kind
from psfs.common.system import KEPT_BYTES, physical_memory
from psfs.footage.layouts import Footage, find_layout
from psfs.footage.media import Decoder, Media, pad_pictures
from psfs.footage.memory import recall
from psfs.footage.numbering import pair_by_number
from psfs.footage.settings import MIXTURES, SequenceSettings, join_delays, split_delays
from psfs.footage.sound import apply_sound
from psfs.footage.threads import prefetch
from psfs.footage.timing import Delay, synchronise

R = TypeVar("R")

#: Greatest memory and number of frames that are decoded ahead.
_QUEUE_BYTES, _QUEUE_FRAMES = 256 * 2**20, 16
#: Frame rate of a camera that states none, that of most, frames/s.
DEFAULT_FPS = 30.0
#: Time after which a picture that has not been decoded never will be, s.
_TIMEOUT_S = 60.0


@dataclass(frozen=True, eq=False)
class Frame:
    """The pictures or masks of all views at one time. Views smaller than the rig's width and height
    are zero padded.

    images: (V, H, W, 3) uint8 BGR, or None if there are only masks. masks: (V, H, W) uint8, 255 =
    person, or None if silhouettes are computed with a `Background`.
    """

    index: int
    images: np.ndarray | None
    masks: np.ndarray | None


def frame_memory_limit() -> float:
    """Return how many bytes the frames of a sequence may take.

    With one process per core, all frames together then take a quarter of the machine's memory.
    """
    return min(2**30, physical_memory() / (4 * (os.cpu_count() or 1)))


def frame_input(frame: Frame, background: Background | None) -> np.ndarray:
    """Return the input of the silhouettes: the frame's pictures (V, H, W, 3), or its masks (V, H,
    W) if there is no background. Raises InputError if the frame lacks them.
    """
    pictures = frame.masks if background is None else frame.images
    if pictures is None:
        kind = "masks" if background is None else "pictures"
        raise InputError(f"frame {frame.index} has no {kind}, which its silhouettes are made of")
    return pictures


class Sequence:
    """Synchronised views with their rig (metres, Z up), background and frame rate.

    `Sequence.open(folder)`, then iterate, or `frames(slice)`, or `read(index)`. A sequence holds no
    open files: each iteration decodes by itself, unless `keep_frames` was called.
    """

    def __init__(
        self, folder: Path, layout: str, footage: Footage, settings: SequenceSettings
    ) -> None:
        self.folder = folder
        self.name = resolve_path(folder).name
        self.layout = layout
        if settings.sync is None and footage.late:
            settings = settings.replace(sync=footage.late)
        settings, heard = apply_sound(settings, footage.images)
        self.settings = settings
        delays = split_delays(settings.sync)
        if settings.cameras is not None:
            delays = {name: by for name, by in delays.items() if name in settings.cameras}
        footage, numbering = pair_by_number(footage)
        self.notes = [*footage.notes, *heard]
        self.footage, self.timing, pairing = synchronise(footage, settings.fps, delays, DEFAULT_FPS)
        self.timing_notes = [*numbering, *pairing]
        self.unit = footage.unit
        self.subject: str = settings.subject or "person"
        self.notes += self.timing_notes
        if settings.fps is None and not any(
            media.fps for media in footage.images or footage.masks or ()
        ):
            self.notes.append(f"no frame rate is known: {DEFAULT_FPS:g} per second is assumed")
        self.fps = self.timing.fps
        self.rig: CameraRig = rotate_rig(footage.rig, rotation_to_z_up(settings.up or "z"))
        self.background_kind = self._background_kind()
        self.volume: tuple[np.ndarray, np.ndarray] | None = self._volume()
        self._kept: np.ndarray | None = None
        self._is_kept = np.zeros(0, bool)

    @classmethod
    def open(cls, folder: str | Path, **overrides: object) -> Sequence:
        """Recognise the folder's layout and read its calibration.

        overrides: the keys of `sequence.toml` (see `SequenceSettings`); they win over the file,
        which wins over the layout's own defaults. Raises InputError if the settings, files and
        calibration do not fit together.
        """
        check_kind("folder", folder, (str, os.PathLike), needed=True)
        folder = Path(folder)
        stated = SequenceSettings.from_dict({k: v for k, v in overrides.items() if v is not None})
        if stated.calibration is not None:  # a flag's path is the caller's, not the folder's
            stated = stated.replace(calibration=str(resolve_path(stated.calibration)))
        settings = stated.fill_from(SequenceSettings.read(folder / "sequence.toml"))
        layout = find_layout(folder, settings)
        settings = settings.fill_from(layout.defaults)
        try:
            sequence = cls(folder, layout.name, layout.read(folder, settings), settings)
            _refuse_unused(stated, sequence)
            return sequence
        except InputError as error:
            if str(folder) in str(error):
                raise
            raise type(error)(f"{folder}: {error}") from None

    def with_cameras(self, names: Collection[str]) -> Sequence:
        """Return the same views of these cameras only. Raises InputError for unknown names."""
        return self._again(self.settings.replace(cameras=tuple(names)))

    def with_all_cameras(self) -> Sequence:
        """Return the same views of all cameras."""
        return self._again(self.settings.replace(cameras=None))

    def with_rig(self, rig: CameraRig) -> Sequence:
        """Return the same views with `rig`, a revised calibration of the same cameras."""
        other = copy(self)
        other.rig = rig
        return other

    def synchronise(self, late: Mapping[str, int]) -> Sequence:
        """Return the same views with late ones shifted; `late`: number of frames of the sequence,
        by the camera's name."""
        delays = split_delays(self.settings.sync)
        own = self.timing.count_own_frames([late.get(name, 0) for name in self.rig.names])
        for name, by in zip(self.rig.names, own, strict=True):
            before, speed = delays.get(name, (0, 1))
            delays[name] = before + by, speed
        return self.with_delays(delays)

    def with_delays(self, delays: Mapping[str, Delay]) -> Sequence:
        """Return the same views with these delays of their cameras, by name."""
        return self._again(self.settings.replace(sync=join_delays(delays)))

    def _again(self, settings: SequenceSettings) -> Sequence:
        """Open the same folder with other settings."""
        layout = find_layout(self.folder, settings)
        return Sequence(self.folder, layout.name, layout.read(self.folder, settings), settings)

    def __len__(self) -> int:
        """Count the frames that every view has."""
        return min(media.count for media in self._views or self.footage.masks or ())

    def __iter__(self) -> Iterator[Frame]:
        return self.frames()

    def read(self, index: int) -> Frame:
        """Decode one frame; negative indices count from the end. Raises IndexError for an index out
        of range."""
        number = range(len(self))[index]
        with self._reader(None) as read:
            return read(number)

    def frames(self, selection: slice | None = None) -> Iterator[Frame]:
        """Yield the selected frames in order, decoded in a background thread ahead of the caller.

        At most 16 frames or 256 MiB are decoded ahead, but at least one. Raises InputError, naming
        file and frame, when one cannot be decoded.
        """
        return self.select_frames(range(len(self))[selection or slice(None)])

    def select_frames(self, indices: Items[int]) -> Iterator[Frame]:
        """Yield the frames of these numbers as `frames` does."""
        nbytes = 4 * len(self.rig) * self.rig.width * self.rig.height
        depth = max(1, min(_QUEUE_FRAMES, _QUEUE_BYTES // nbytes))
        return prefetch(self._decode(indices), depth)

    @property
    def keeps_frames(self) -> bool:
        """Whether decoded frames are kept in memory, see `keep_frames`."""
        return self._kept is not None

    def keep_frames(self) -> None:
        """Keep the decoded frames of a short sequence in memory for the lifetime of this object, so
        that each is decoded once. None are kept if frames have masks, or if all together would
        exceed `frame_memory_limit`.
        """
        shape = (len(self), len(self.rig), self.rig.height, self.rig.width, 3)
        without_masks = self.background_kind in ("gaussian", "frames", "chroma")
        if without_masks and 0 < math.prod(shape) <= frame_memory_limit():
            self._kept = np.empty(shape, np.uint8)
            self._is_kept = np.zeros(len(self), bool)

    @property
    def inputs(self) -> list[Path]:
        """Folders and files that the sequence is read from."""
        footage = self.footage
        media = (*(footage.images or ()), *(footage.masks or ()), *(footage.background or ()))
        stated = self.settings.calibration
        calibration = [self.folder / stated] if stated is not None else []
        return [self.folder, *dict.fromkeys(m.paths[0].parent for m in media), *calibration]

    @property
    def has_images(self) -> bool:
        """Whether frames have pictures, not masks only."""
        return self.footage.images is not None

    @cached_property
    def background(self) -> Background | None:
        """The empty scene, or None if frames come with masks. It is estimated on first use."""
        return self.recall("background", self._estimate_background, _is_small)

    def recall(
        self, key: object, compute: Callable[[], R], keeps: Callable[[R], bool] = lambda _: True
    ) -> R:
        """Return the result of `compute` on this footage, which an earlier sequence of the same
        files, settings and cameras may have computed, see `psfs.footage.memory`."""
        footage = self.footage
        media = (*(footage.images or ()), *(footage.masks or ()), *(footage.background or ()))
        files = [path.stat() for item in media for path in item.paths]
        stamps = [(of.st_ino, of.st_mtime_ns, of.st_size) for of in files]
        # The fields alone: what a camera has computed from them is kept beside them.
        cameras = [[getattr(camera, of.name) for of in fields(camera)] for camera in self.rig]
        settings = repr(self.settings)  # a stated volume's arrays cannot be compared with `==`
        whole = (key, media, stamps, settings, pickle.dumps(cameras))
        return recall(self.folder.resolve(), whole, compute, keeps)

    def _estimate_background(self) -> Background | None:
        if self.background_kind in ("gaussian", "frames"):
            films = self.footage.background if self.background_kind == "gaussian" else None
            assert self.footage.images is not None
            return estimate_background_from_take(self.rig, self.footage.images, films)
        if self.background_kind == "chroma":
            empty = self.footage.background
            assert self.footage.images is not None
            media = empty or self.footage.images
            return key_from_media(self.rig, media, bool(empty), self.settings.key)
        return None

    @property
    def empty_scene(self) -> bool:
        """Whether the background does not come from the frames themselves, in which a person who
        keeps still becomes background."""
        if self.background_kind in MIXTURES:
            return bool(self.footage.background)
        return self.background_kind != "frames"

    @cached_property
    def _mixture(self) -> Mixture:
        """The fitted mixture, which is kept."""
        return self._fit_mixture()

    def _fit_mixture(self, adaptive: bool = False) -> Mixture:
        empty = self.footage.background
        assert self.footage.images is not None
        shadows = self.background_kind != "mog-plain"
        return Mixture(empty or self.footage.images, bool(empty), adaptive, shadows=shadows)

    @property
    def _views(self) -> tuple[Media, ...]:
        """All media that a frame is decoded from."""
        masks = self.footage.masks if self.background_kind == "masks" else None
        return (*(self.footage.images or ()), *(masks or ()))

    def _background_kind(self) -> str:
        footage, kind = self.footage, self.settings.background
        if kind is None:
            kind = "masks" if footage.masks else "gaussian" if footage.background else "frames"
        needs = {
            "masks": (footage.masks, "masks for every camera"),
            "gaussian": (footage.background, "pictures of the empty scene in background/"),
            "threshold": (footage.images and self.settings.threshold, "images and `threshold`"),
            "frames": (footage.images, "images"),
            **dict.fromkeys(MIXTURES, (footage.images, "images")),
            "chroma": (footage.images, "images"),
        }
        there, what = needs[kind]
        if not there:
            raise InputError(f"{self.folder}: background kind {kind} needs {what}; found none")
        if kind == "frames" and self.settings.background is None:
            self.notes.append(
                "no film of the empty scene: the background is estimated from the frames; a "
                "person who never moves becomes part of it"
            )
        return kind

    def _volume(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the stated volume in metres with Z up, converted if it was stated in the file's
        own axes."""
        stated = self.settings.volume
        if not isinstance(stated, Mapping):
            return stated
        corners = np.array(list(product(*np.transpose(stated["own"]))))
        if LEFT_HANDED in self.notes:
            corners = corners @ MIRROR
        corners = metres_per_unit(self.unit) * corners @ rotation_to_z_up(self.settings.up or "z").T
        return corners.min(axis=0), corners.max(axis=0)

    @contextmanager
    def reader(self, learning: bool = True) -> Iterator[Callable[[int], Frame]]:
        """Return a context with `read(index)` for frames in any order.

        Reading forwards is cheapest. All views are decoded at the same time. With `learning`, an
        adaptive mixture starts from the fitted one for each reader and is updated by the frames
        that are read; otherwise it stays as fitted.

        Raises InputError as `frames` does.
        """
        adaptive = learning and self.background_kind in ("mog-adaptive", "mog-plain")
        with self._reader(self._fit_mixture(True) if adaptive else None) as read:
            yield read

    @contextmanager
    def _reader(self, mixture: Mixture | None) -> Iterator[Callable[[int], Frame]]:
        """Return the context of `reader`. If silhouettes come from a mixture, that is `mixture`, by
        default the fitted one."""
        decoders: list[Decoder] = []  # opened by the first frame that is not kept
        workers = min(len(self._views), os.cpu_count() or 1)
        try:
            with ThreadPool(workers) as pool:  # a hanging thread does not outlive the process
                yield lambda index: self._frame(index, decoders, pool, mixture)
        finally:  # only after the pool has ended: if one view fails, others may still be read
            for decoder in decoders:
                decoder.close()

    def _decode(self, indices: Items[int]) -> Generator[Frame, None, None]:
        """Decode frames in order."""
        with self.reader() as read:
            for index in indices:
                yield read(index)

    def _frame(
        self, index: int, decoders: list[Decoder], pool: ThreadPool, mixture: Mixture | None
    ) -> Frame:
        if self._kept is not None and self._is_kept[index]:
            return Frame(index, self._kept[index], None)
        shape = (len(self.rig), self.rig.height, self.rig.width)
        images, masks = None, None
        if self.has_images:
            kept = self._kept
            images = np.empty((*shape, 3), np.uint8) if kept is None else kept[index]
        pictures = self._pictures(index, decoders, pool, images)
        seen = pictures[: len(self.rig)]
        if self.background_kind == "masks":
            masks = [picture.max(axis=-1) for picture in pictures[-len(self.rig) :]]
        elif self.background_kind == "threshold":
            masks = pool.map(partial(find_bright, settings=self.settings), seen)
        elif self.background_kind in MIXTURES:
            masks = pool.starmap(mixture or self._mixture, enumerate(seen))
        if images is not None:
            pad_pictures(seen, images)
        padded = None if masks is None else pad_pictures(masks, np.empty(shape, np.uint8))
        frame = Frame(index, images, padded)
        if self._kept is not None:
            self._is_kept[index] = True
        return frame

    def _pictures(
        self, index: int, decoders: list[Decoder], pool: ThreadPool, images: np.ndarray | None
    ) -> list[np.ndarray]:
        """Decode a frame of all views; views of the rig's size are written directly into
        `images`."""
        size = self.rig.width, self.rig.height
        places = [*(images if images is not None else ()), *len(self._views) * [None]]
        into = [
            place if media.size == size else None
            for media, place in zip(self._views, places, strict=False)
        ]
        decoders += [media.open() for media in self._views[len(decoders) :]]
        calls = [
            pool.apply_async(decoder.read, (index, place))
            for decoder, place in zip(decoders, into, strict=True)
        ]
        for media, call in zip(self._views, calls, strict=True):
            call.wait(_TIMEOUT_S)
            if not call.ready():
                decoders.clear()  # a decoder in use must not be closed
                raise InputError(
                    f"{media.where}: frame {index} was not decoded within {_TIMEOUT_S:g} s; "
                    "expected a file that can be read"
                )
        return [call.get() for call in calls]


def _is_small(background: Background | None) -> bool:
    """Return whether a background is small enough to be kept for a later sequence."""
    return background is None or background.mean.nbytes + background.std.nbytes <= KEPT_BYTES


def _refuse_unused(stated: SequenceSettings, sequence: Sequence) -> None:
    """Raise InputError for a key that the caller states and a sequence does not use."""
    kind = sequence.background_kind
    owners = {"key": "chroma", **dict.fromkeys(("threshold", "dilate", "erode"), "threshold")}
    for key, owner in owners.items():
        if getattr(stated, key) is not None and kind != owner:
            raise InputError(f"`{key}` applies only to the background {owner}; this one is {kind}")
    if stated.take is not None and sequence.layout != "HumanEva":
        raise InputError("`take` applies only to folders with several takes (HumanEva's)")


def find_bright(image: np.ndarray, settings: SequenceSettings) -> np.ndarray:
    """Return the mask (h, w) uint8 of pixels brighter than the threshold, closed with a square
    (dilated, then eroded)."""
    assert settings.threshold is not None
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    mask: np.ndarray = np.where(grey > settings.threshold * 255, np.uint8(255), np.uint8(0))
    for radius, operation in ((settings.dilate, cv2.dilate), (settings.erode, cv2.erode)):
        if radius:
            mask = operation(mask, np.ones((2 * radius + 1, 2 * radius + 1), np.uint8))
    return mask
