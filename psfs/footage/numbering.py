"""Which pictures are of one time, by the numbers in their names: where one camera lacks some."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from cl import InputError
from psfs.cameras.names import listed
from psfs.footage.layouts.common import Footage
from psfs.footage.media import Media

#: Numbers that at least this share of the pictures have in common are the frames'.
_COMMON = 0.5
#: So many missing numbers are named.
_NAMED = 5


def numbered(footage: Footage) -> tuple[Footage, list[str]]:
    """Return the footage whose pictures go together by number where going by order would not do,
    and a remark on that.

    Order does where there are videos, names without numbers, or numbers that run alike from where
    each camera begins.
    """
    kinds = [kind for kind in (footage.images, footage.masks) if kind]
    numbers = {id(item): _numbers(item) for kind in kinds for item in kind}
    lists = list(numbers.values())
    if not all(lists):
        for kind in kinds:
            _check_extra(kind)
        return footage, []
    shortest = min(map(len, lists))
    if len({tuple(n - own[0] for n in own[:shortest]) for own in lists}) == 1:
        return footage, _shifted(kinds[0], lists)
    common = sorted(set.intersection(*map(set, lists)))
    if len(common) < _COMMON * max(map(len, lists)):
        return footage, []
    everywhere = set().union(*lists)
    lacking = [
        f"{item.name} lacks {_some(sorted(everywhere - set(numbers[id(item)])))}"
        for kind in kinds
        for item in kind
        if everywhere - set(numbers[id(item)])
    ]

    def chosen(kind: tuple[Media, ...] | None) -> tuple[Media, ...] | None:
        if kind is None:
            return None
        places = [{n: index for index, n in enumerate(numbers[id(item)])} for item in kind]
        return tuple(
            item.picked([place[n] for n in common])
            for item, place in zip(kind, places, strict=True)
        )

    paired = replace(footage, images=chosen(footage.images), masks=chosen(footage.masks))
    return paired, [
        "pictures go together by the numbers in their names; those that not all cameras have are "
        f"left out: {listed(lacking)}"
    ]


def _numbers(item: Media) -> list[int]:
    """Return the last number in the name of each picture; none where that says nothing."""
    found = [re.findall(r"[0-9]{1,18}", path.stem) for path in item.paths]
    numbers = [int(digits[-1]) for digits in found if digits]
    usable = not item.is_video and len(set(numbers)) == len(item.paths)
    return numbers if usable else []


def _shifted(kind: tuple[Media, ...], lists: list[list[int]]) -> list[str]:
    """Return a remark on pictures that go together in order, where their numbers would pair them
    otherwise."""
    common = set.intersection(*map(set, lists))
    if len({own[0] for own in lists}) == 1 or len(common) < _COMMON * max(map(len, lists)):
        return []
    shown = listed(f"{item.name} {own[0]}" for item, own in zip(kind, lists, strict=False))
    return [f"pictures go together in order, though their numbers begin differently: {shown}"]


def _check_extra(kind: tuple[Media, ...]) -> None:
    """Raise InputError for a camera with more pictures than one that is numbered throughout,
    because some of them have a number twice, or none."""
    usual = [len(numbers) for numbers in map(_numbers, kind) if numbers]
    for item in kind:
        if not usual or item.is_video or len(item.paths) <= max(usual):
            continue
        first: dict[str, Path] = {}
        for path in item.paths:
            digits = re.findall(r"[0-9]{1,18}", path.stem)
            number = str(int(digits[-1])) if digits else ""
            if number and number not in first:
                first[number] = path
                continue
            has = f"has the number of {first[number].name}" if number else "has no number"
            raise InputError(f"{path}: {has}; expected one picture for each frame")


def _some(numbers: list[int]) -> str:
    more = f" and {len(numbers) - _NAMED} more" if len(numbers) > _NAMED else ""
    return " ".join(map(str, numbers[:_NAMED])) + more
