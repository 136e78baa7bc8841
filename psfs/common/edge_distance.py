"""Sizes of the exact distance transform on a device. Counterpart of common/distance.h."""

from __future__ import annotations

from cl import Device, InputError
from cl.workgroups import pack_defines

#: Items that work on a tile of the maps, and a tile's edge, px: the fastest on PoCL and on a H200.
_GROUP = 256
TILE = 32
#: Rows of a tile where distances take two bytes, which need more local memory.
_FEW_ROWS = 8
#: Longest distance whose square, and that of a column beside it, fits into two bytes.
_SHORT = 180
#: Bytes that a CPU reads together.
LOT = 16


def distance_defines(device: Device, width: int, height: int, reach: int) -> dict[str, int]:
    """Return the defines of distance.h for pictures of a size, px, and distances up to `reach` px.

    Raises InputError for a reach that the device's local memory has no room for.
    """
    rows = TILE if reach <= _SHORT else _FEW_ROWS
    span = TILE + 2 * reach
    lot = 1 if device.is_gpu else LOT
    # A gap and its square, see distance.h, and a row more.
    nbytes = rows * span * 3 + span if reach <= _SHORT else 2 * (rows * span + span)
    room = device.handle.local_mem_size - 8 * LOT
    if nbytes > room:
        raise InputError(
            f"distances up to {reach} px need {nbytes} bytes of local memory; expected at most "
            f"{room} on {device.name}"
        )
    return pack_defines(device, _GROUP) | {
        "WIDTH": width,
        "HEIGHT": height,
        "REACH": reach,
        "TILE": TILE,
        "TILE_ROWS": rows,
        "LOT": lot,
    }


def tiles_of(defines: dict[str, int]) -> int:
    """Return the number of tiles of a picture."""
    columns = -(-defines["WIDTH"] // defines["TILE"])
    return columns * -(-defines["HEIGHT"] // defines["TILE_ROWS"])
