"""Pair the cameras' pictures by the numbers in their names, where some cameras lack pictures."""

from __future__ import annotations

import re
from pathlib import Path

from cl import InputError
from psfs.cameras.names import join_names
from psfs.common.ranges import NAMED
from psfs.footage.layouts.common import Footage
from psfs.footage.media import Media

#: If the pictures have at least this share of their numbers in common, these number the frames.
_MIN_COMMON_SHARE = 0.5


def pair_by_number(footage: Footage) -> tuple[Footage, list[str]]:
    """Pair pictures by number where pairing by order would be wrong; return the footage and a
    remark.

    Pairing by order is right for videos, for names without numbers, and for numbers that run alike
    from each camera's first.
    """
    kinds = [kind for kind in (footage.images, footage.masks) if kind]
    numbers = {id(item): _read_numbers(item) for kind in kinds for item in kind}
    lists = list(numbers.values())
    if not all(lists):
        for kind in kinds:
            _check_extra(kind)
        return footage, []
    shortest = min(map(len, lists))
    if len({tuple(n - own[0] for n in own[:shortest]) for own in lists}) == 1:
        return footage, _remark_on_shift(kinds[0], lists)
    common = sorted(set.intersection(*map(set, lists)))
    if len(common) < _MIN_COMMON_SHARE * max(map(len, lists)):
        return footage, []
    everywhere = set().union(*lists)
    lacking = [
        f"{item.name} lacks {_shorten_list(sorted(everywhere - set(numbers[id(item)])))}"
        for kind in kinds
        for item in kind
        if everywhere - set(numbers[id(item)])
    ]

    places = {key: {n: index for index, n in enumerate(own)} for key, own in numbers.items()}
    return footage.select(lambda item, _: [places[id(item)][n] for n in common]), [
        "pictures go together by the numbers in their names; those that not all cameras have are "
        f"left out: {join_names(lacking)}"
    ]


def _read_numbers(item: Media) -> list[int]:
    """Return the last number in each picture's name; an empty list if these do not number the
    frames."""
    numbers = [n for path in item.paths if (n := _find_number(path)) is not None]
    usable = not item.is_video and len(set(numbers)) == len(item.paths)
    return numbers if usable else []


def _find_number(path: Path) -> int | None:
    digits = re.findall(r"[0-9]{1,18}", path.stem)
    return int(digits[-1]) if digits else None


def _remark_on_shift(kind: tuple[Media, ...], lists: list[list[int]]) -> list[str]:
    """Return a remark on pictures paired in order though their numbers would pair them
    otherwise."""
    common = set.intersection(*map(set, lists))
    if len({own[0] for own in lists}) == 1 or len(common) < _MIN_COMMON_SHARE * max(
        map(len, lists)
    ):
        return []
    shown = join_names(f"{item.name} {own[0]}" for item, own in zip(kind, lists, strict=False))
    return [f"pictures go together in order, though their numbers begin differently: {shown}"]


def _check_extra(kind: tuple[Media, ...]) -> None:
    """Raise InputError for a camera that has more pictures than a fully numbered one.

    Some of its pictures then have a number twice, or none.
    """
    usual = [len(numbers) for numbers in map(_read_numbers, kind) if numbers]
    for item in kind:
        if not usual or item.is_video or len(item.paths) <= max(usual):
            continue
        first: dict[int | None, Path] = {}
        for path in item.paths:
            number = _find_number(path)
            if number is not None and first.setdefault(number, path) is path:
                continue
            has = "has no number" if number is None else f"has the number of {first[number].name}"
            raise InputError(f"{path}: {has}; expected one picture for each frame")


def _shorten_list(numbers: list[int]) -> str:
    more = f" and {len(numbers) - NAMED} more" if len(numbers) > NAMED else ""
    return " ".join(map(str, numbers[:NAMED])) + more
