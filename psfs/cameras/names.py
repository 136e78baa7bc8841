"""Camera names: natural order, and the match of files to cameras."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TypeVar

from cl import InputError

T = TypeVar("T")


def name_tokens(name: str) -> tuple[str, ...]:
    """Split a name into words and numbers: `cam_01`, `Cam01` and `cam-1` all give ("cam", "1")."""
    tokens = re.findall(r"[^\W\d_]+|\d+", name.lower())
    return tuple(str(int(token)) if token.isdigit() else token for token in tokens)


def natural_key(name: str) -> tuple[tuple[int, int, str], ...]:
    """Return a sorting key that puts cam_2 before cam_10."""
    return tuple((0, int(t), "") if t.isdigit() else (1, 0, t) for t in name_tokens(name))


def contains_name(text: str, name: str) -> bool:
    """Return whether `text` contains the tokens of `name` in a row (`silh_cam01_023`, `cam01`)."""
    inner, outer = name_tokens(name), name_tokens(text)
    starts = range(len(outer) - len(inner) + 1)
    return bool(inner) and any(outer[i : i + len(inner)] == inner for i in starts)


def join_names(names: Iterable[str]) -> str:
    """Join names for a message: `a, b, c` or `none`."""
    return ", ".join(names) or "none"


def match_files_to_cameras(
    cameras: Sequence[str], names: Sequence[str], where: str, wanted: Sequence[str] | None = None
) -> tuple[dict[str, str], str | None]:
    """Match files of `names` to cameras; return them by camera, and a remark if the match was
    guessed.

    A file belongs to the camera whose name it has, else to the one whose name its own contains
    (case, separators and leading zeros do not matter; of nested names the longer; what all files'
    names contain tells nothing). If such names do not settle it but the counts
    agree, files and cameras are paired in natural order, unless that gives a file to another camera
    than the one that it is named after. `wanted`: cameras that must have a file,
    default all; with it further files may be there. Raises InputError, naming both lists, if they
    do not fit, and for a name that fits several cameras.
    """
    named = _match_named(cameras, names, where)
    needed = cameras if wanted is None else wanted
    if all(camera in named for camera in needed):
        if wanted is not None or len(names) == len(cameras):
            return named, None
    elif len(names) == len(cameras):
        ordered = dict(
            zip(sorted(cameras, key=natural_key), sorted(names, key=natural_key), strict=True)
        )
        guess = ", ".join(f"{name} for {camera}" for camera, name in ordered.items())
        crossed = [camera for camera in named if ordered[camera] != named[camera]]
        if crossed:
            raise InputError(
                f"{where}: some are named after cameras and others after none, and in order they "
                f"would be {guess}; expected the names of the cameras, {join_names(cameras)}"
                f"{_example(cameras, names)}"
            )
        return ordered, f"{where}: names differ from the cameras'; taken in order: {guess}"
    raise InputError(
        f"{where}: {len(names)} of them ({join_names(names)}) for {len(needed)} cameras "
        f"({join_names(needed)}); expected one per camera, or `cameras` to choose some"
        f"{_example(cameras, names)}"
    )


def _match_named(cameras: Sequence[str], files: Sequence[str], where: str) -> dict[str, str]:
    """Return the files that are named after a camera, by camera. Raises InputError for a name that
    fits several cameras, and for several that fit one."""
    shared = set.intersection(*(set(name_tokens(name)) for name in files)) if files else set()
    fitting: dict[str, list[str]] = {}
    for name in files:
        fits = [camera for camera in cameras if name_tokens(camera) == name_tokens(name)] or [
            camera for camera in cameras if contains_name(name, camera)
        ]
        owners = [
            camera
            for camera in fits
            if not any(contains_name(other, camera) for other in fits if other != camera)
        ]
        if len(owners) > 1:
            owners = [
                camera for camera in owners if not shared.issuperset(name_tokens(camera))
            ] or owners
        if len(owners) > 1:
            raise InputError(
                f"{where}: {name} fits several cameras: {join_names(owners)}; expected a name "
                f"that contains one of {join_names(cameras)}{_example(cameras, files)}"
            )
        for camera in owners:
            fitting.setdefault(camera, []).append(name)
    named = {}
    for camera, names in fitting.items():
        if len(names) == len(files) > 1:
            continue  # what all names contain tells nothing
        same = [name for name in names if name_tokens(name) == name_tokens(camera)] or names
        if len(same) > 1:
            raise InputError(
                f"{where}: {join_names(same)} all fit camera {camera}; expected one per camera"
                f"{_example(cameras, files)}"
            )
        named[camera] = same[0]
    return named


def _example(cameras: Sequence[str], names: Sequence[str]) -> str:
    """Return the hint of a table that says which file is whose."""
    if not cameras or not names:
        return ""
    return f", or a table in sequence.toml: [files] {cameras[0]} = {names[0]!r}, ..."


def rename_files(
    by_name: Mapping[str, T], files: Mapping[str, str] | None, where: str | None = None
) -> dict[str, T]:
    """Return what was found by name, under the cameras' names where `files` says whose it is, by
    camera; other names as they are.

    where: place of the files; raises InputError for one that is not there. None: without one of
    them, all names are as they are."""
    renamed, moved = dict(by_name), {}
    for camera, name in (files or {}).items():
        same = [old for old in renamed if name_tokens(old) == name_tokens(name)]
        if len(same) != 1:
            if where is None:
                return dict(by_name)
            raise InputError(
                f"{where}: `files` says {name} for {camera}; there are {join_names(by_name)}"
            )
        moved[camera] = renamed.pop(same[0])
    return {**renamed, **moved}
