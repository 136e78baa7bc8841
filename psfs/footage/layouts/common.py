"""What a folder layout finds, and how pictures are assigned to cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cl import InputError
from psfs.cameras.calibration import Calibration, Size, Sizes, read_calibration
from psfs.cameras.camera import CameraRig
from psfs.cameras.names import matched
from psfs.cameras.units import Unit
from psfs.footage.media import Media, opened_media, picture_size
from psfs.footage.settings import Settings

#: Files by camera name, as found in a folder.
Found = Mapping[str, list[Path]]


@dataclass(frozen=True)
class Footage:
    """What lies in a folder, one `Media` per camera of the rig (metres, the file's own axes).

    unit: of the calibration's numbers. late: by how many of their frames cameras come late, as
    files say, by name.

    notes: remarks about guesses that were made, for `psfs info`.
    """

    rig: CameraRig
    unit: Unit = "m"
    images: tuple[Media, ...] | None = None
    masks: tuple[Media, ...] | None = None
    background: tuple[Media, ...] | None = None
    notes: list[str] = field(default_factory=list)
    late: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Layout:
    """A kind of folder. `defaults` are what its makers' documentation says of the data."""

    name: str
    matches: Callable[[Path, Settings], bool]
    read: Callable[[Path, Settings], Footage]
    defaults: Settings = field(default_factory=Settings)


def read_rig(path: Path, settings: Settings, found: Found, where: Path) -> Calibration:
    """Return the calibration at `path`; sizes that it lacks are taken from the pictures `found`."""
    return read_calibration(path, settings.unit, sizes_of(found, where, settings))


def sizes_of(found: Found, where: Path, settings: Settings) -> Sizes:
    """Return what gives a calibration's names the sizes of the pictures that match them."""
    return lambda names: measured_sizes(names, found, where, settings)


def measured_sizes(
    names: Sequence[str], found: Found, where: Path, settings: Settings
) -> list[Size]:
    """Return the size of each named camera's pictures."""
    pairs, _ = matched(names, list(found), str(where), settings.cameras)
    measured = {camera: picture_size(found[name][0]) for camera, name in pairs.items()}
    # Cameras without pictures are among those that the subset leaves out.
    return [measured.get(name) or next(iter(measured.values())) for name in names]


def assigned(
    calibrated: CameraRig, found: Found, where: Path, settings: Settings, extras: bool = False
) -> tuple[tuple[Media, ...], list[str]]:
    """Return the pictures of the chosen ones of the calibrated cameras, and remarks.

    All that are calibrated are matched, so that pictures belong to the same cameras whichever are
    chosen. With `extras`, files that belong to no camera are passed over. Raises InputError when
    files and cameras do not fit, or a picture's size is not its camera's.
    """
    subset = extras or settings.cameras is not None
    rig = chosen(calibrated, settings)
    wanted = rig.names if subset else None
    pairs, note = matched(calibrated.names, list(found), str(where), wanted)
    media = opened_media({name: found[pairs[name]] for name in rig.names})
    for camera, item in zip(rig, media, strict=True):
        if item.size != camera.size:
            raise InputError(
                f"{item.where}: {item.size[0]} x {item.size[1]} pixels; "
                f"camera {camera.name} is calibrated for {camera.size[0]} x {camera.size[1]}"
            )
    return media, [note] if note else []


def chosen(rig: CameraRig, settings: Settings) -> CameraRig:
    """Return the cameras that the settings name, or all."""
    return rig if settings.cameras is None else rig.subset(settings.cameras)
