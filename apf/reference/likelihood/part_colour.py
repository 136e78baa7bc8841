"""Colour models of the body's parts. Twin of apf/likelihood/part_colour.py,
part_colour.cl and the term in likelihood.cl."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from apf.body.cones import project_outlines
from apf.body.kinematics import posed_cones
from apf.body.model import BodyModel
from apf.likelihood.part_colour import (
    BOUND,
    COLUMNS,
    DECAY,
    LEAST_SAMPLES,
    N_CODES,
    RARE,
    RATIO_STEPS,
    ROWS,
    find_trunk_cone,
    fit_palette,
    list_histogram_parts,
    list_part_names,
    list_scored_parts,
)
from apf.likelihood.term import SharedTwin, TermTwin
from apf.likelihood.terms import PartColourConfig
from psfs.cameras.camera import Camera, CameraRig
from psfs.voxels.host_voxels import HostVoxels

_NO_CODE, _HIDDEN_CODE = N_CODES - 1, N_CODES - 2


def encode_colours(
    pictures: np.ndarray, silhouettes: np.ndarray, palette: np.ndarray
) -> np.ndarray:
    """Return the codes (V, H, W) uint8 of pictures (V, H, W, 3) uint8 BGR by `palette` (32768,),
    N_CODES - 2 where silhouettes (V, H, W) are hidden, 254, and N_CODES - 1 outside of them."""
    blue, green, red = np.moveaxis(pictures.astype(int) >> 3, -1, 0)
    rest = np.where(silhouettes == 254, _HIDDEN_CODE, _NO_CODE)
    colours = palette[blue << 10 | green << 5 | red]
    return np.where(silhouettes == 255, colours, rest).astype(np.uint8)


def is_in_outline(corners: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Return whether pixels (..., 2) lie in trapezoids with corners (..., 4, 2); never in one that
    is NaN."""
    onwards = np.roll(corners, -1, -2) - corners
    to = pixels[..., None, :] - corners
    sides = onwards[..., 0] * to[..., 1] - onwards[..., 1] * to[..., 0]
    return np.all(sides >= 0, axis=-1) | np.all(sides <= 0, axis=-1)


def sample_outlines(quad: np.ndarray, t: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the points at the shares t along and u across trapezoids with corners (4, ...)."""
    left, right = quad[0] + t * (quad[3] - quad[0]), quad[1] + t * (quad[2] - quad[1])
    return left + u * (right - left)


def lookup_pixels(camera: Camera, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows and columns (...) int of pixels (..., 2), 0 outside of the picture, and whether
    they lie in it."""
    x, y = np.moveaxis(np.floor(np.nan_to_num(pixels, nan=-1e6) + 0.5), -1, 0)
    inside = (x >= 0) & (y >= 0) & (x < camera.size[0]) & (y < camera.size[1])
    return np.where(inside, y, 0).astype(int), np.where(inside, x, 0).astype(int), inside


def _lookup_codes(camera: Camera, codes: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Return the codes at pixels (..., 2), -1 outside of the picture."""
    rows, columns, inside = lookup_pixels(camera, pixels)
    return np.where(inside, codes[rows, columns].astype(int), -1)


def count_codes(rig: CameraRig, body: BodyModel, pose: np.ndarray, codes: np.ndarray) -> np.ndarray:
    """Count the samples (P, N_CODES) of each part at a pose (D,) that show each of the codes (V, H,
    W); samples with another cone before or behind them are ignored."""
    cones = posed_cones(body, pose[None])
    parts = list_histogram_parts(body)
    counts = np.zeros((len(list_part_names(body)), N_CODES))
    t = ((np.arange(ROWS) + 0.5) / ROWS)[:, None, None]
    u = ((np.arange(COLUMNS) + 0.5) / COLUMNS)[:, None]
    for camera, view in zip(rig, codes, strict=True):
        corners = project_outlines(camera, cones)[0]
        for c, corner in enumerate(corners):
            pixels = sample_outlines(corner, t, u)
            others = np.delete(corners, c, 0)
            alone = ~is_in_outline(others[:, None, None], pixels).any(0)
            code = _lookup_codes(camera, view, pixels)
            taken = alone & (code >= 0) & (code < _HIDDEN_CODE) & (parts[c][:, None] >= 0)
            part = np.broadcast_to(parts[c][:, None], code.shape)
            np.add.at(counts, (part[taken], code[taken]), 1)
    return counts


def compute_ratios(histograms: np.ndarray) -> np.ndarray:
    """Return (P, N_CODES) int8: the log of how much likelier each code is on a part than on the
    mean part, RATIO_STEPS at the bound and beyond."""
    total = histograms.sum(1, keepdims=True)
    share = histograms / np.maximum(total, 1)
    mean = share.sum(0) / max(1, int((total > 0).sum()))
    ratio = np.log((share + RARE) / (mean + RARE)) / BOUND
    ratio = ratio * np.minimum(total / LEAST_SAMPLES, 1)
    ratio[:, _HIDDEN_CODE:] = 0
    return np.rint(RATIO_STEPS * np.clip(ratio, -1, 1)).astype(np.int8)


def hidden_by_trunk(
    camera: Camera,
    body: BodyModel,
    cones: np.ndarray,
    corners: np.ndarray,
    rows: np.ndarray,
    pixels: np.ndarray,
) -> np.ndarray:
    """Return (N, R, K) bool: whether the trunk hides samples at pixels (N, R, K, 2) of rows (R, 4)
    of cones. A sample is hidden if it lies in the outline of the trunk's cone and its row is
    farther from the camera than the trunk's middle. cones (N, C, 16), corners (N, C, 4, 2): their
    outlines."""
    trunk = find_trunk_cone(body)
    if trunk < 0:
        return np.zeros(pixels.shape[:3], bool)
    sampled = cones[:, rows[:, 0].astype(int)]
    sampled = sampled[..., 0:3] + rows[:, 1, None] * (sampled[..., 4:7] - sampled[..., 0:3])
    middle = (cones[:, trunk, None, 0:3] + cones[:, trunk, None, 4:7]) / 2
    further: np.ndarray = (sampled - middle) @ camera.R[2] > 0
    return further[..., None] & is_in_outline(corners[:, trunk, None, None], pixels)


class ColourModel(NamedTuple):
    """Colours of the parts: log ratios (P, N_CODES) int8, see `compute_ratios`; the part (R,) of
    each sample row, -1 for rows that are ignored; and the rows (R, 4), see `make_sample_rows`."""

    ratios: np.ndarray
    row_parts: np.ndarray
    rows: np.ndarray


def colour_means(
    camera: Camera,
    body: BodyModel,
    cones: np.ndarray,
    codes: np.ndarray,
    look: ColourModel,
) -> np.ndarray:
    """Return (N,) the mean log ratio, as a share of its bound, of the codes (H, W) at the samples
    in the rows of cones (N, C, 16), by the colour model `look`; 0 without a visible sample. Samples
    that the trunk or something else hides are ignored."""
    scored = look.row_parts >= 0
    rows, parts = look.rows[scored], look.row_parts[scored]
    corners = project_outlines(camera, cones)
    quads = np.moveaxis(corners[:, rows[:, 0].astype(int), None], 3, 0)
    columns = np.arange(int(rows[:, 2].max(initial=0)))
    u = ((columns + 0.5) / rows[:, 2, None])[..., None]
    pixels = sample_outlines(quads, rows[:, 1, None, None], u)  # (N, rows, columns, 2)
    code = _lookup_codes(camera, codes, pixels)
    hidden = hidden_by_trunk(camera, body, cones, corners, rows, pixels)
    seen = (columns < rows[:, 2, None]) & (code >= 0) & (code != _HIDDEN_CODE) & ~hidden
    ratios = look.ratios[parts[:, None], np.maximum(code, 0)].astype(float)
    means: np.ndarray = np.where(seen, ratios, 0).sum((1, 2))
    return means / (RATIO_STEPS * np.maximum(seen.sum((1, 2)), 1))


class NumpyPartColours(TermTwin):
    """The term in NumPy; `codes` (V, H, W) of the latest frame, None where nothing is known;
    `ratios` (P, N_CODES) int8 of the learned colour models."""

    def __init__(self, shared: SharedTwin, settings: PartColourConfig) -> None:
        self._scene, self._settings, self._rows = shared.scene, settings, shared.rows
        self._row_parts = list_scored_parts(shared.scene.body, shared.rows)
        self.codes: np.ndarray | None = None
        self._palette: np.ndarray | None = None
        self.forget()

    def forget(self) -> None:
        self.histograms = np.zeros((len(list_part_names(self._scene.body)), N_CODES))
        self.ratios = np.zeros(self.histograms.shape, np.int8)

    def learn(self, pose: np.ndarray) -> None:
        if self.codes is not None:
            counts = count_codes(self._scene.rig, self._scene.body, pose, self.codes)
            self.histograms = DECAY * self.histograms + counts
            self.ratios = compute_ratios(self.histograms)

    def observe(self, voxels: HostVoxels, maps: np.ndarray) -> None:
        self.codes, pictures, silhouettes = None, voxels.pictures, maps[..., 0]
        if pictures is None:
            return
        if self._palette is None:
            self._palette = fit_palette(pictures, silhouettes)
        if self._palette is not None:
            self.codes = encode_colours(pictures, silhouettes, self._palette)

    def view_errors(self, view: int, cones: np.ndarray) -> np.ndarray | None:
        if self.codes is None:
            return None
        camera, body, codes = self._scene.rig[view], self._scene.body, self.codes[view]
        look = ColourModel(self.ratios, self._row_parts, self._rows)
        return -self._settings.weight * colour_means(camera, body, cones, codes, look)
