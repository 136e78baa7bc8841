"""Cut a long take into overlapping chunks, and join the chunks' tracks."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from apf.tracking.track import Track, concatenate_tracks


@dataclass(frozen=True)
class Seam:
    """The join of two chunks.

    frame: first frame of the later chunk. distance: mean distance of the joints there, m; infinite
    if the chunks share no frame in which neither is lost.
    """

    frame: int
    distance: float


def cut_chunks(frames: range, n_frames: int, overlap: int) -> list[range]:
    """Return the frames of each chunk: about `n_frames`, and `overlap` frames of the next chunk."""
    n_parts = max(1, round(len(frames) / n_frames))
    edges = np.linspace(0, len(frames), n_parts + 1).round().astype(int).tolist()
    if n_parts > 1 and min(np.diff(edges)) <= overlap:
        return [frames]
    return [frames[a : min(b + overlap, len(frames))] for a, b in pairwise(edges)]


def find_seam(first: Track, second: Track) -> Seam:
    """Find the frame of the overlap in which two tracks agree best."""
    shared, of_first, of_second = np.intersect1d(first.frames, second.frames, return_indices=True)
    if not shared.size:
        return Seam(int(second.frames[0]), np.inf)
    apart = np.linalg.norm(first.joints[of_first] - second.joints[of_second], axis=-1).mean(1)
    apart[first.lost[of_first] | second.lost[of_second]] = np.inf
    best = int(np.argmin(apart))
    return Seam(int(shared[best]), float(apart[best]))


def join_tracks(tracks: Sequence[Track]) -> tuple[Track, list[Seam]]:
    """Join the tracks of consecutive chunks; return the track and its seams.

    Its provenance is that of the first, with the seams under `parts`.
    """
    seams = [find_seam(a, b) for a, b in pairwise(tracks)]
    begins = [-np.inf, *(s.frame for s in seams)]
    ends = [*(s.frame for s in seams), np.inf]
    parts = [
        track.select((track.frames >= begin) & (track.frames < end))
        for track, begin, end in zip(tracks, begins, ends, strict=True)
    ]
    provenance = json.loads(tracks[0].provenance)
    provenance["parts"] = [
        {"frame": s.frame, "apart_mm": to_millimetres(s.distance)} for s in seams
    ]
    whole = replace(concatenate_tracks(parts), provenance=json.dumps(provenance))
    return whole, seams


def to_millimetres(distance: float) -> float | None:
    """Convert a distance, m, to mm for a file; None if it is not finite."""
    return round(1000 * distance, 1) if np.isfinite(distance) else None
