"""Sizes of the exact distance transform on a device; counterpart of common/distance.h."""

from __future__ import annotations

from cl import Device, InputError
from cl.workgroups import GROUP, pack_defines

#: Edge, px, of a work-group's tile of the maps: the fastest on PoCL and on an H200.
TILE = 32
#: Rows of a tile if distances take two bytes, which need more local memory.
_FEW_ROWS = 8
#: Longest distance, px, whose square, and that of a neighbouring column, fits into two bytes.
_SHORT = 180
#: Distances up to here, px, share a CPU's program.
_SHARED = 64
#: Bytes that a CPU processes together.
LOT = 16


def distance_defines(device: Device, reach: int) -> dict[str, int]:
    """Return the compile-time definitions of distance.h.

    reach: largest distance, px. Raises InputError if the device's local memory is too small for it.
    """
    known = {"REACH": reach} if device.is_gpu else {}
    reach = reach if device.is_gpu else max(reach, _SHARED)
    rows = TILE if reach <= _SHORT else _FEW_ROWS
    span = TILE + 2 * reach
    lot = 1 if device.is_gpu else LOT
    # A gap and its square, see distance.h, and one more row.
    nbytes = rows * span * 3 + span if reach <= _SHORT else 2 * (rows * span + span)
    room = device.handle.local_mem_size - 8 * LOT
    if nbytes > room:
        raise InputError(
            f"distances up to {reach} px need {nbytes} bytes of local memory; expected at most "
            f"{room} on {device.name}"
        )
    return pack_defines(device, GROUP) | {
        **known,
        "MOST_REACH": reach,
        "TILE": TILE,
        "TILE_ROWS": rows,
        "LOT": lot,
    }


def count_tiles(defines: dict[str, int], picture: tuple[int, int]) -> int:
    """Count the tiles of a picture, width x height px."""
    width, height = picture
    return -(-width // defines["TILE"]) * -(-height // defines["TILE_ROWS"])
