"""Shapes of work-groups, and the number of values that a work-item processes at once."""

from __future__ import annotations

from cl import Device

#: Work-group along a row on CPUs.
ALONG = 64
#: Work-items of a GPU that share a piece of work: a particle, a tile, a picture.
GROUP = 256
#: The same of work that waits for memory most of the time, or of few pieces, such as cameras.
WIDE_GROUP = 512
#: Neighbouring pixels that a work-item works on at once.
PIXELS = 8


def row_group(device: Device) -> tuple[int, int, int]:
    """Return the work-group of kernels whose dimension 0 runs along rows.

    PoCL turns a CPU's work-group into one loop, which becomes vector code, and compiles a kernel
    again for every shape of work-group: so the shape does not depend on the row. A GPU gets small
    tiles.
    """
    return (32, 4, 1) if device.is_gpu else (ALONG, 1, 1)


def pixel_pack(device: Device, width: int) -> int:
    """Return PACK of pack.h for kernels of pictures `width` pixels wide: neighbours in a row that
    a work-item works on at once."""
    return 1 if device.is_gpu or width < 2 * PIXELS else PIXELS


def pack_defines(device: Device, group: int) -> dict[str, int]:
    """Return PACK and GROUP of pack.h.

    GPUs take `group` items for a piece of work (a particle, a tile), or as many as they can, where
    CPUs take one item, which works on PACK numbers at once: as many as their vectors have, 16 with
    AVX-512 (2,000 poses scored in 13 ms instead of 19), else 8.
    """
    if device.is_gpu:
        return {"PACK": 1, "GROUP": min(group, device.handle.max_work_group_size)}
    return {"PACK": 16 if device.handle.native_vector_width_float >= 16 else 8, "GROUP": 1}


def size_defines(
    device: Device,
    picture: tuple[int, int] | None = None,
    grid: tuple[int, int, int] | None = None,
) -> dict[str, int]:
    """Return the sizes of sizes.h for a GPU; none for a CPU, for which they are arguments alone.

    GPUs gain 2 % of a streamed frame (H200). On CPUs arguments cost up to 10 % in some kernels, as
    much as others gain (PoCL), and .2 s less is compiled for every program and kernel of a take of
    another size.
    """
    if not device.is_gpu:
        return {}
    pictures = {} if picture is None else dict(zip(("WIDTH", "HEIGHT"), picture, strict=True))
    return pictures | ({} if grid is None else dict(zip(("NX", "NY", "NZ"), grid, strict=True)))


def pack_size(n: int, defines: dict[str, int]) -> tuple[int]:
    """Return the global size for `n` particles: a work-group for every pack of them."""
    return (-(-n // defines["PACK"]) * defines["GROUP"],)
