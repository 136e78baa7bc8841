"""A long take in overlapping chunks: where it is cut, and how the chunks' tracks are joined."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from apf.tracking.track import Track


@dataclass(frozen=True)
class ChunksConfig:
    """How chunks overlap and when they agree."""

    overlap: float = 1.0
    """s that two chunks share. A track has settled on a start that was found within about half."""
    agreement: float = 0.05
    """m, mean over the joints, up to which two tracks of a frame are the same but for noise: runs
    with different seeds lie about 10 to 20 mm apart, a wrong start 100 and more."""


@dataclass(frozen=True)
class Seam:
    """Where two chunks are joined: the first frame of the later one, and the mean distance of their
    joints there, m; infinite where they share no frame that both are sure of."""

    frame: int
    distance: float


def cut(frames: range, n_frames: int, overlap: int) -> list[range]:
    """Return the frames of each chunk: about `n_frames`, and `overlap` of the next chunk's."""
    n_chunks = max(1, round(len(frames) / n_frames))
    edges = np.linspace(0, len(frames), n_chunks + 1).round().astype(int).tolist()
    if n_chunks > 1 and min(np.diff(edges)) <= overlap:
        return [frames]
    return [frames[a : min(b + overlap, len(frames))] for a, b in pairwise(edges)]


def seam(first: Track, second: Track) -> Seam:
    """Return the frame of the overlap in which two tracks agree best."""
    shared, of_first, of_second = np.intersect1d(first.frames, second.frames, return_indices=True)
    if not shared.size:
        return Seam(int(second.frames[0]), np.inf)
    apart = np.linalg.norm(first.joints[of_first] - second.joints[of_second], axis=-1).mean(1)
    apart[first.lost[of_first] | second.lost[of_second]] = np.inf
    best = int(np.argmin(apart))
    return Seam(int(shared[best]), float(apart[best]))


def joined(tracks: Sequence[Track]) -> tuple[Track, list[Seam]]:
    """Return one track out of those of chunks in their order, and its seams. Its provenance is that
    of the first, with the seams under `parts`."""
    seams = [seam(a, b) for a, b in pairwise(tracks)]
    begins = [-np.inf, *(s.frame for s in seams)]
    ends = [*(s.frame for s in seams), np.inf]
    rows = [
        (track.frames >= begin) & (track.frames < end)
        for track, begin, end in zip(tracks, begins, ends, strict=True)
    ]

    def stacked(name: str) -> np.ndarray:
        return np.concatenate([getattr(t, name)[r] for t, r in zip(tracks, rows, strict=True)])

    names = set.intersection(*(set(track.diagnostics) for track in tracks))
    diagnostics = {
        name: np.concatenate([t.diagnostics[name][r] for t, r in zip(tracks, rows, strict=True)])
        for name in tracks[0].diagnostics
        if name in names
    }
    said = json.loads(tracks[0].provenance)
    said["parts"] = [{"frame": s.frame, "apart_mm": millimetres(s.distance)} for s in seams]
    whole = replace(
        tracks[0],
        frames=stacked("frames"),
        poses=stacked("poses"),
        joints=stacked("joints"),
        diagnostics=diagnostics,
        provenance=json.dumps(said),
    )
    return whole, seams


def millimetres(distance: float) -> float | None:
    """Return a distance, m, as mm for a file; None where there is none."""
    return round(1000 * distance, 1) if np.isfinite(distance) else None
