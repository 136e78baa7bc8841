"""Which pictures are of one time, by the numbers in their names: where one camera lacks some."""

from __future__ import annotations

import re
from dataclasses import replace

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
        return footage, []
    shortest = min(map(len, lists))
    if len({tuple(n - own[0] for n in own[:shortest]) for own in lists}) == 1:
        return footage, []
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


def _some(numbers: list[int]) -> str:
    more = f" and {len(numbers) - _NAMED} more" if len(numbers) > _NAMED else ""
    return " ".join(map(str, numbers[:_NAMED])) + more
