"""Colour models of the body's parts (kernels: part_colour.cl, likelihood.cl).

A silhouette does not show an arm in front of the trunk, but its colour does. As in the sums of
Gaussians of Stoll et al. 2011, the term compares the colours in a part's outline with the colours
of that part. It uses histograms, which can hold several colours per part: for each code of a
palette, the likelihood ratio of the code on the part and on the mean part.
"""

from __future__ import annotations

from functools import cache, lru_cache

import cv2
import numpy as np
import scipy

from apf.body.limbs import trunk_bones
from apf.body.model import BodyModel
from apf.body.posing import CONE_DEFINES, body_defines, pack_body
from apf.likelihood.term import Shared, Term
from apf.likelihood.terms import PartColourConfig
from cl import Array, Launch
from cl.signature import Argument
from cl.workgroups import WIDE_GROUP, pack_defines
from psfs.voxels.device_voxels import CarvedVoxels

#: Number of codes: the palette's colours, and the last two, for pixels inside the silhouettes whose
#: colour is hidden by furniture or by another person, and for those outside.
N_CODES = 64
#: Log ratios are quantised to this many steps up to their bound.
RATIO_STEPS = 127
#: Samples along and across a cone from which histograms are counted.
ROWS, COLUMNS = 10, 6
#: Bits per channel of the palette's lookup table, and the table's number of colours.
_BITS = 5
N_COLOURS = 1 << 3 * _BITS
#: Number of colours of the palette: a fixed grid of 256 colours distinguishes skin and a red shirt
#: less well. Least number of pixels of a person from which a palette is made.
_PALETTE_COLOURS, _LEAST_PIXELS = 48, 500
#: Share that histograms keep from frame to frame: about a second at 30 frames/s. Likelihood of a
#: code on a part that never showed it. Bound of the log ratios, nats, so that no colour is
#: impossible on a part. Number of samples from which on a part's ratios count in full.
DECAY, RARE, BOUND, LEAST_SAMPLES = 0.97, 0.004, 2.0, 60.0
#: Number of pixels from which a palette is made: more pixels change it little.
_PALETTE_PIXELS = 4096
#: Pixels that an item of a CPU encodes.
_STRIP = 64


def list_part_names(body: BodyModel) -> list[str]:
    """Return the names of the parts that have a colour model: those of the cones that are visible
    in images, with left and right as one part."""
    return list(dict.fromkeys(_strip_side(cone.name) for cone in body.cones if cone.in_images))


def _strip_side(name: str) -> str:
    return name[2:] if name[:2] in ("l_", "r_") else name


def find_part(body: BodyModel, cone: int, share: float) -> int:
    """Return the index in `list_part_names` of the part at `share` of a cone's length; -1 for a
    cone that is not compared with images.

    The end of a cone beyond a joint on it, such as a hand beyond the wrist, is bare skin like the
    head; it counts as head, if the body has one.
    """
    shape, names = body.cones[cone], list_part_names(body)
    if not shape.in_images:
        return -1
    axis = shape.end - shape.start
    for joint in (each for each in body.joints if each.bone == shape.bone):
        at = float((joint.position - shape.start) @ axis / (axis @ axis))
        if 0.5 < at < 1 and share > at and "head" in names:
            return names.index("head")
    return names.index(_strip_side(shape.name))


def list_scored_parts(body: BodyModel, rows: np.ndarray) -> np.ndarray:
    """Return (R,) int32 the part of each of the likelihood's sample rows (R, 4); -1 for the trunk,
    as other parts are in front of it in most pictures."""
    trunk = trunk_bones(body)
    parts = [
        -1 if body.cones[int(row[0])].bone in trunk else find_part(body, int(row[0]), float(row[1]))
        for row in rows
    ]
    return np.array(parts, np.int32)


def list_histogram_parts(body: BodyModel) -> np.ndarray:
    """Return (C, ROWS) int32 the part of each row of samples for the histograms."""
    shares = (np.arange(ROWS) + 0.5) / ROWS
    parts = [[find_part(body, c, share) for share in shares] for c in range(len(body.cones))]
    return np.array(parts, np.int32)


def find_trunk_cone(body: BodyModel) -> int:
    """Return the thickest cone of the trunk in the images, which hides limbs behind it; -1 without
    one."""
    trunk = trunk_bones(body)
    chosen = [c for c, cone in enumerate(body.cones) if cone.in_images and cone.bone in trunk]
    return max(chosen, key=lambda c: float(np.mean(body.cones[c].radii)), default=-1)


def fit_palette(pictures: np.ndarray, silhouettes: np.ndarray) -> np.ndarray | None:
    """Fit a palette to the colours of pictures (V, H, W, 3) uint8 BGR inside silhouettes (V, H, W).

    Return (N_COLOURS,) uint8 the code of every colour, blue in the highest bits; None if there are
    too few pixels. The palette is found by k-means in CIE Lab with half the weight on lightness,
    which shading changes.
    """
    person = pictures[silhouettes == 255]
    if len(person) < _LEAST_PIXELS:
        return None
    chosen = person[np.arange(_PALETTE_PIXELS) * len(person) // _PALETTE_PIXELS]
    return _cluster_colours(chosen.tobytes())


@lru_cache(maxsize=8)  # rival starts begin in the same frame
def _cluster_colours(colours: bytes) -> np.ndarray:
    """Return the palette (N_COLOURS,) of colours (N, 3) uint8."""
    centres, _ = scipy.cluster.vq.kmeans2(
        _lab(np.frombuffer(colours, np.uint8).reshape(-1, 3)), _PALETTE_COLOURS,
        iter=20, minit="++", seed=0, missing="warn",
    )  # fmt: skip
    return scipy.spatial.cKDTree(centres).query(_every_colour())[1].astype(np.uint8)


@cache
def _every_colour() -> np.ndarray:
    """Return the colours (N_COLOURS, 3) of the lookup table, as `_lab` has them."""
    levels = (np.arange(1 << _BITS) << 8 - _BITS) + (1 << 7 - _BITS)
    every = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), -1).reshape(-1, 3)
    return _lab(every.astype(np.uint8))


def _lab(colours: np.ndarray) -> np.ndarray:
    lab = cv2.cvtColor(np.ascontiguousarray(colours)[None], cv2.COLOR_BGR2LAB)[0]
    return lab.astype(np.float32) * np.array([0.5, 1, 1], np.float32)


class PartColours(Term):
    """Term that compares the colours in each part's outline with that part's colour model.

    `codes` (V, H, W) uint8: codes of the latest frame, in the first of two arrays; the histograms
    are counted from the second, which may be the same array, see `Ahead`. `ratios` (P, N_CODES)
    int8: quantised log ratios of each code's likelihood on a part and on the mean part; 0 before
    the first update. `known`: whether the frame has codes; it has none without pictures or before a
    person was seen. Twin: reference/likelihood/part_colour.py.
    """

    kernels = "tracking/part_colour"
    uses_pictures = True

    def __init__(self, shared: Shared, settings: PartColourConfig) -> None:
        device, body, rig = shared.scene.opencl, shared.scene.body, shared.scene.rig
        n_parts, self._group = len(list_part_names(body)), pack_defines(device, WIDE_GROUP)["GROUP"]
        self._strip = 1 if device.is_gpu else _STRIP
        super().__init__(
            device, PACK=1, GROUP=self._group, N_CODES=N_CODES, **body_defines(body),
            N_PARTS=n_parts, ROWS=ROWS, COLUMNS=COLUMNS, RATIO_STEPS=RATIO_STEPS, STRIP=self._strip,
            **rig.defines, **CONE_DEFINES,
        )  # fmt: skip
        self.settings, self._maps, self._rig = settings, shared.maps, rig
        self._cameras = shared.cameras
        self.codes, self._histogram_codes = shared.seen["codes"]
        for each in shared.seen["codes"]:
            each.fill(N_CODES - 1)
        self._palette = device.empty((N_COLOURS,), np.uint8)
        self.known = self._has_palette = False
        histograms = n_parts, N_CODES
        self.histograms = device.zeros(histograms, np.float32)
        self.ratios = device.zeros(histograms, np.int8)
        self._counts = device.zeros(histograms, np.int32)
        self._rows = device.to_device(list_histogram_parts(body))
        self._body = device.to_device(pack_body(body), "the body model")
        self._pictures: Array | None = None

    def change_body(self, body: BodyModel) -> None:
        """Update from poses of `body` from now on; only its numbers may differ."""
        self._body.set(pack_body(body))
        self._rows.set(list_histogram_parts(body))

    def forget(self) -> None:
        for array in (self.histograms, self.ratios):
            array.fill(0)

    def observe(self, voxels: CarvedVoxels, pictures: Array | None) -> None:
        """Enqueue the coding of a frame's pictures (V, H, W, 3); its maps must be made before. Make
        the palette when a person is first visible, which waits for the device."""
        if pictures is None:
            if self.known:
                self.codes.fill(N_CODES - 1)  # no update from this frame
                self.known = False
            return
        if pictures is not self._pictures:
            self._pictures, self._encode = pictures, self._encoding_launch(pictures)
        if not self._has_palette:
            palette = fit_palette(pictures.get(), self._maps.get()[..., 0])
            if palette is None:
                return
            self._palette.set(palette)
            self._has_palette = True
        self.known = True
        self._encode()

    def _encoding_launch(self, pictures: Array) -> Launch:
        n_pixels = int(np.prod(self.codes.shape))
        return self.launch(
            "encode_colours",
            (-(-n_pixels // self._strip),),
            (256 if self.device.is_gpu else 64,),
            n_pixels=n_pixels,
            maps=self._maps,
            pictures=pictures,
            palette=self._palette,
            codes=self.codes,
        )

    def learning_launcher(self, pose: Array) -> list[Launch]:
        return [
            self.launch(
                "count_colours",
                (self._group * len(self._rig),),
                (self._group,),
                width=self._rig.width,
                height=self._rig.height,
                cameras=self._cameras,
                poses=pose,
                table=self._body,
                row_parts=self._rows,
                codes=self._histogram_codes,
                counts=self._counts,
            ),
            self.launch(
                "learn_colours",
                (N_CODES,),
                (N_CODES,),
                decay=DECAY,
                rare=RARE,
                bound=BOUND,
                least=LEAST_SAMPLES,
                counts=self._counts,
                histograms=self.histograms,
                ratios=self.ratios,
            ),
        ]

    def score_arguments(self) -> dict[str, Argument]:
        return {"ratios": self.ratios}

    def score_weights(self) -> dict[str, float]:
        return {"colour_weight": self.settings.weight if self.known else 0.0}
