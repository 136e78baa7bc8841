"""The contents of a folder layout, and the assignment of pictures to cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from cl import InputError
from psfs.cameras.calibration import read_calibration
from psfs.cameras.calibration.common import Calibration, Size
from psfs.cameras.camera import CameraRig
from psfs.cameras.names import match_files_to_cameras
from psfs.cameras.units import Unit
from psfs.common.progress import map_in_threads
from psfs.footage.media import Media, open_media, read_picture_size
from psfs.footage.settings import SequenceSettings

#: What a picture's size with its sides exchanged means.
_TURNED = (
    ": it was turned by a quarter; turn it back (ffmpeg -vf transpose=1 or 2), or calibrate it as "
    "it was filmed: docs/from_phones.md"
)
#: Files by camera name, as found in a folder.
Found = Mapping[str, list[Path]]


@dataclass(frozen=True)
class Footage:
    """The media of a folder, one `Media` per camera of the rig (metres, the file's own axes).

    unit: of the calibration's numbers. notes: remarks on guesses, for `psfs info`. late: by how
    many of its own frames each camera starts late according to the files, by name.
    """

    rig: CameraRig
    unit: Unit = "m"
    images: tuple[Media, ...] | None = None
    masks: tuple[Media, ...] | None = None
    background: tuple[Media, ...] | None = None
    notes: list[str] = field(default_factory=list)
    late: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        masks = self.masks and tuple(replace(item, is_mask=True) for item in self.masks)
        object.__setattr__(self, "masks", masks)

    def select(self, frames: Callable[[Media, int], Sequence[int]]) -> Footage:
        """Return the footage whose images and masks have those frames of each medium that `frames`
        returns for it and for the number of its view."""

        def chosen(kind: tuple[Media, ...] | None) -> tuple[Media, ...] | None:
            return kind and tuple(item.select(frames(item, v)) for v, item in enumerate(kind))

        return replace(self, images=chosen(self.images), masks=chosen(self.masks))


@dataclass(frozen=True)
class Layout:
    """A kind of folder; `defaults` are what its makers' documentation says of the data."""

    name: str
    matches: Callable[[Path, SequenceSettings], bool]
    read: Callable[[Path, SequenceSettings], Footage]
    defaults: SequenceSettings = field(default_factory=SequenceSettings)


def read_rig(path: Path, settings: SequenceSettings, found: Found, where: Path) -> Calibration:
    """Read the calibration at `path`; sizes that it lacks come from the pictures `found`."""
    return read_calibration(path, settings.unit, partial(measure_sizes, found, where, settings))


def measure_sizes(
    found: Found, where: Path, settings: SequenceSettings, names: Sequence[str]
) -> list[Size]:
    """Return the size of each named camera's pictures."""
    pairs, _ = match_files_to_cameras(names, list(found), str(where), settings.cameras)
    measured = {camera: read_picture_size(found[name][0]) for camera, name in pairs.items()}
    # A camera without pictures is not among the chosen ones, so any size will do.
    return [measured.get(name) or next(iter(measured.values())) for name in names]


def assign_pictures(
    calibrated: CameraRig,
    found: Found,
    where: Path,
    settings: SequenceSettings,
    extras: bool = False,
) -> tuple[tuple[Media, ...], list[str]]:
    """Assign pictures to the chosen cameras; return them with remarks.

    Pictures are matched to all calibrated cameras, so that the match does not depend on which
    cameras are chosen. extras: ignore files that belong to no camera. Raises InputError if files
    and cameras do not match, or if a picture's size differs from its camera's.
    """
    subset = extras or settings.cameras is not None
    rig = choose_cameras(calibrated, settings)
    wanted = rig.names if subset else None
    pairs, note = match_files_to_cameras(calibrated.names, list(found), str(where), wanted)
    media = tuple(map_in_threads(lambda name: open_media(name, found[pairs[name]]), rig.names))
    for camera, item in zip(rig, media, strict=True):
        if item.size != camera.size:
            turned = item.size == camera.size[::-1]
            raise InputError(
                f"{item.where}: {item.size[0]} x {item.size[1]} pixels; "
                f"camera {camera.name} is calibrated for {camera.size[0]} x {camera.size[1]}"
                f"{_TURNED if turned else ''}"
            )
    return media, [note] if note else []


def assemble(
    calibrated: Calibration,
    settings: SequenceSettings,
    kinds: Mapping[str, tuple[Found, Path]],
    extras: bool = False,
    notes: Sequence[str] = (),
    late: Mapping[str, int] | None = None,
) -> Footage:
    """Return the footage of the chosen cameras.

    kinds: the files by camera, and their place for messages, of images, masks and background; those
    without files are left out. extras, and errors: see `assign_pictures`.
    """
    remarks, media = list(notes), dict[str, tuple[Media, ...]]()
    for kind, (found, where) in kinds.items():
        if found:
            more = extras or kind == "background"
            media[kind], said = assign_pictures(calibrated, found, where, settings, more)
            remarks += said
    rig = choose_cameras(calibrated, settings)
    return Footage(rig, calibrated.unit, notes=remarks, late=late or {}, **media)


def choose_cameras(rig: CameraRig, settings: SequenceSettings) -> CameraRig:
    """Return the rig of the cameras that the settings name, or of all."""
    return rig if settings.cameras is None else rig.subset(settings.cameras)
