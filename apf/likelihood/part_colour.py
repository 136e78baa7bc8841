"""What colours each part of the body has in the pictures (kernels: part_colour.cl, likelihood.cl).

Silhouettes do not show an arm before the trunk; its colour does. As sums of Gaussians do (Stoll et
al. 2011) the term asks whether what a camera sees where a part should be has that part's colour,
but with histograms, which know more than one colour per part: of each code of a palette, how much
likelier it is on the part than on the mean part.
"""

from __future__ import annotations

import cv2
import numpy as np
from scipy.cluster.vq import kmeans2

from apf.body.limbs import trunk_bones
from apf.body.model import BodyModel
from apf.body.posing import CONE_DEFINES, body_defines, pack_body
from apf.likelihood.term import Shared, Term
from apf.likelihood.terms.part_colour import PartColourConfig
from cl import Array, Launch
from cl.signature import Argument
from cl.workgroups import pack_defines
from psfs.voxels.device_voxels import Voxels

#: Items that a GPU takes for a camera: there are few, each has a multiprocessor to itself.
_GROUP = 512
#: Codes: numbers of a palette's colours, and the last one for pixels outside the silhouettes.
N_CODES = 64
#: Ratios are kept in so many steps up to their bound.
RATIO_STEPS = 127
#: Samples along and across a cone from which colours are learnt.
ROWS, COLUMNS = 10, 6
#: Bits of each channel that a palette looks at, and colours that it has then.
_BITS = 5
N_COLOURS = 1 << 3 * _BITS
#: Pixels from which a palette is made: more change it little.
_PALETTE_PIXELS = 4096


def part_names(body: BodyModel) -> list[str]:
    """Return the names of the parts that have colours of their own: those of the cones in the
    images, left and right alike."""
    return list(dict.fromkeys(_two_sided(cone.name) for cone in body.cones if cone.in_images))


def _two_sided(name: str) -> str:
    return name[2:] if name[:2] in ("l_", "r_") else name


def part_of(body: BodyModel, cone: int, share: float) -> int:
    """Return the number in `part_names` of the part that a cone is at this share of its length, -1
    for a cone that is not looked for in the images.

    What a cone holds beyond a joint that lies on it, a hand beyond the wrist, is as bare as the
    head and counts as that, where the body has one.
    """
    own, names = body.cones[cone], part_names(body)
    if not own.in_images:
        return -1
    axis = own.end - own.start
    for joint in body.joints:
        at = float((joint.position - own.start) @ axis / (axis @ axis))
        if joint.bone == own.bone and 0.5 < at < 1 and share > at and "head" in names:
            return names.index("head")
    return names.index(_two_sided(own.name))


def scored_parts(body: BodyModel, rows: np.ndarray) -> np.ndarray:
    """Return (R,) int32 the part of each of the likelihood's rows (R, 4), -1 for the trunk's: other
    parts lie before it in most pictures."""
    trunk = trunk_bones(body)
    parts = [
        -1 if body.cones[int(row[0])].bone in trunk else part_of(body, int(row[0]), float(row[1]))
        for row in rows
    ]
    return np.array(parts, np.int32)


def learnt_parts(body: BodyModel) -> np.ndarray:
    """Return (C, ROWS) int32 the part of each row of samples that colours are learnt from."""
    shares = (np.arange(ROWS) + 0.5) / ROWS
    parts = [[part_of(body, c, share) for share in shares] for c in range(len(body.cones))]
    return np.array(parts, np.int32)


def trunk_cone(body: BodyModel) -> int:
    """Return the thickest cone of the trunk in the images, which hides limbs behind it; -1 without
    one."""
    trunk = trunk_bones(body)
    chosen = [c for c, cone in enumerate(body.cones) if cone.in_images and cone.bone in trunk]
    return max(chosen, key=lambda c: float(np.mean(body.cones[c].radii)), default=-1)


def palette_of(
    pictures: np.ndarray, silhouettes: np.ndarray, config: PartColourConfig
) -> np.ndarray | None:
    """Return (N_COLOURS,) uint8 the code of every colour, blue's bits first, by the colours inside
    silhouettes (V, H, W) of pictures (V, H, W, 3) uint8 BGR; None where too few pixels are.

    The palette is found by k-means in CIE Lab, in which lightness counts half: shading changes it.
    """
    person = pictures[silhouettes == 255]
    if len(person) < config.least_pixels:
        return None
    chosen = person[np.arange(_PALETTE_PIXELS) * len(person) // _PALETTE_PIXELS]
    n = min(config.n_colours, N_CODES - 1)
    centres, _ = kmeans2(_lab(chosen), n, iter=20, minit="++", seed=0, missing="warn")
    levels = (np.arange(1 << _BITS) << 8 - _BITS) + (1 << 7 - _BITS)
    every = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), -1).reshape(-1, 3)
    away = ((_lab(every.astype(np.uint8))[:, None] - centres) ** 2).sum(-1)
    codes: np.ndarray = away.argmin(1).astype(np.uint8)
    return codes


def _lab(colours: np.ndarray) -> np.ndarray:
    lab = cv2.cvtColor(np.ascontiguousarray(colours)[None], cv2.COLOR_BGR2LAB)[0]
    return lab.astype(np.float32) * np.array([0.5, 1, 1], np.float32)


class PartColours(Term):
    """The colours of a body's parts in the pictures that the maps (V, H, W, 2) are silhouettes of.

    `codes` (V, H, W) uint8 become those of the latest frame, the first of two arrays; it is learnt
    from the second, which may be the same, see `Ahead`. `ratios` (R, P, N_CODES) int8 of R runs,
    in steps, say how much likelier each code is on a part than on the mean part, and are 0 until
    something is learnt. `known` tells whether there are codes at all: frames without pictures, or
    without a person, have none. Twin: reference/likelihood/part_colour.py.
    """

    kernels = "tracking/part_colour"
    uses_pictures = True

    def __init__(self, shared: Shared, settings: PartColourConfig) -> None:
        device, body, rig = shared.scene.opencl, shared.scene.body, shared.scene.rig
        n_parts, self._group = len(part_names(body)), pack_defines(device, _GROUP)["GROUP"]
        super().__init__(
            device, PACK=1, GROUP=self._group, N_CODES=N_CODES, **body_defines(body),
            N_PARTS=n_parts, ROWS=ROWS, COLUMNS=COLUMNS, RATIO_STEPS=RATIO_STEPS, **rig.defines,
            **CONE_DEFINES,
        )  # fmt: skip
        self.settings, self._maps, self._rig = settings, shared.maps, rig
        self._cameras = shared.cameras
        self.codes, self._learnt_from = shared.seen["codes"]
        for each in shared.seen["codes"]:
            each.fill(N_CODES - 1)
        self._palette = device.empty((N_COLOURS,), np.uint8)
        self.known = self._has_palette = False
        histograms = shared.n_runs, n_parts, N_CODES
        self.histograms = device.zeros(histograms, np.float32)
        self.ratios = device.zeros(histograms, np.int8)
        self._counts = device.zeros(histograms, np.int32)
        self._rows = device.to_device(learnt_parts(body))
        self._body = device.to_device(pack_body(body), "the body model")
        self._pictures: Array | None = None

    def change_body(self, body: BodyModel) -> None:
        """Learn from poses of `body`, which differs from the one before in numbers alone."""
        self._body.set(pack_body(body))
        self._rows.set(learnt_parts(body))

    def forget(self, run: int | None = None) -> None:
        """Forget every part's colours, of one run or of all: a new track begins."""
        for array in (self.histograms, self.ratios):
            kept = array.get()
            kept[slice(None) if run is None else run] = 0
            array.set(kept)

    def observe(self, voxels: Voxels, pictures: Array | None) -> None:
        """Enqueue the codes of a frame's pictures (V, H, W, 3), whose maps are made. The first
        person seen makes the palette, which waits for the device."""
        if pictures is None:
            if self.known:
                self.codes.fill(N_CODES - 1)  # nothing is learnt from this frame
                self.known = False
            return
        if pictures is not self._pictures:
            self._pictures, self._encode = pictures, self._encoding(pictures)
        if not self._has_palette:
            palette = palette_of(pictures.get(), self._maps.get()[..., 0], self.settings)
            if palette is None:
                return
            self._palette.set(palette)
            self._has_palette = True
        self.known = True
        self._encode()

    def _encoding(self, pictures: Array) -> Launch:
        n_pixels = int(np.prod(self.codes.shape))
        return self.launch(
            "encode_colours",
            (n_pixels,),
            (256 if self.device.is_gpu else 64,),
            n_pixels=n_pixels,
            maps=self._maps,
            pictures=pictures,
            palette=self._palette,
            codes=self.codes,
        )

    def learning_launcher(self, pose: Array) -> list[Launch]:
        """Return the launches that learn from the frame whose runs' estimates are the first R of
        `pose` (.., D)."""
        settings = self.settings
        return [
            self.launch(
                "count_colours",
                (self._group * len(self._rig), self.ratios.shape[0]),
                (self._group, 1),
                width=self._rig.width,
                height=self._rig.height,
                cameras=self._cameras,
                poses=pose,
                table=self._body,
                row_parts=self._rows,
                codes=self._learnt_from,
                counts=self._counts,
            ),
            self.launch(
                "learn_colours",
                (N_CODES * self.ratios.shape[0],),
                (N_CODES,),
                decay=settings.decay,
                rare=settings.rare,
                bound=settings.bound,
                least=settings.least_samples,
                counts=self._counts,
                histograms=self.histograms,
                ratios=self.ratios,
            ),
        ]

    def score_arguments(self) -> dict[str, Argument]:
        return {"ratios": self.ratios, "table_size": int(np.prod(self.ratios.shape[1:]))}

    def score_weights(self) -> dict[str, float]:
        return {"colour_weight": self.settings.weight if self.known else 0.0}
