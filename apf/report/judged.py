"""The stages `judge_track` and `write`: a track judged, its summary and page written beside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from collections.abc import Sequence as Items
from dataclasses import replace
from pathlib import Path

import numpy as np

from apf.body.surface import paint
from apf.keypoints.keypoints import Keypoints
from apf.report import FILES, OVERLAY, PAGE
from apf.report.agreement import (
    Agreement,
    choose_rows,
    compare_with_silhouettes,
    measure_keypoint_agreement,
)
from apf.report.motion_limits import find_impossible_motion
from apf.report.page import write_page
from apf.report.quality import Quality
from apf.report.summary import SUMMARY, body_facts, read_tracked_grid
from apf.tracking.people import PeopleTracks
from apf.tracking.track import Track
from psfs.common.files import read_text, write_json
from psfs.common.numbers import pick_evenly
from psfs.session import Session


def judge_track(
    session: Session,
    track: Track,
    progress: Callable[[], object] | None = None,
    *,
    keypoints: Keypoints | None = None,
    doubts: Items[str] = (),
    silhouettes: bool = True,
) -> Quality:
    """Return the quality of a track; measured against the silhouettes, unless it is of no frame or
    of no voxels, and against keypoints. progress: called after each frame that is compared with
    silhouettes. doubts: see `Quality`; what people do not do is added. silhouettes: whether the
    track is compared at all with what is seen, but with keypoints."""
    grid = read_tracked_grid(track) if silhouettes else None
    found: Agreement | None = None
    near: np.ndarray | None = None
    if grid is not None and len(track):
        found = compare_with_silhouettes(session, grid, track, progress)
    if keypoints is not None and len(track):
        near = measure_keypoint_agreement(track, keypoints, session.rig)
    if not silhouettes:
        return Quality(track, None, near, tuple(doubts))
    known = (*doubts, *(text for text in find_impossible_motion(track) if text not in doubts))
    return Quality(track, found, near, known)


def paint_surface(quality: Quality) -> Track:
    """Return the track with the colours of its surface, from the voxels that it was compared with.
    Without any it stays as it is."""
    track, agreement = quality.track, quality.agreement
    if track.surface is None or agreement is None:
        return track
    pairs = zip(agreement.rows, agreement.clouds, strict=True)
    seen = [(row, cloud) for row, cloud in pairs if not track.lost[row] and len(cloud)]
    seen = [seen[k] for k in pick_evenly(len(seen))]
    clouds = [(of.centres, of.colour) for _, of in seen if of.colour is not None]
    if not clouds or len(clouds) < len(seen):
        return track
    poses = track.poses[[row for row, _ in seen]]
    colours = paint(track.surface, track.its_body, poses, clouds)
    return replace(track, surface=replace(track.surface, colours=colours))


def keep_judged_frames(session: Session) -> None:
    """Have the session keep those frames, as they are carved while the person is tracked, that
    `judge_track` needs of the whole track."""
    frames = session.frames
    session.keep_carved([frames[int(row)] for row in choose_rows(len(frames))])


def write_report(
    folder: Path, name: str, quality: Quality, facts: Mapping[str, object], page: bool = True
) -> list[str]:
    """Write summary.json, and the `page`, into the `folder` of a track.

    Returns the names of all files there that belong to the track. facts: how it was made. name: of
    the take, the page's title.
    """
    written = [file for file in FILES if (folder / file).exists()]
    written += [SUMMARY, *([PAGE] if page else [])]
    summary = {
        **facts,
        "body": body_facts(quality.track.its_body, quality.track.surface),
        "quality": quality.facts(),
        "says": quality.lines(),
        "files": written,
    }
    if page:
        settings = folder / "settings.toml"
        text = read_text(settings, "settings") if settings.exists() else ""
        track, shown = PeopleTracks.of(quality.track), summary | {"settings": text}
        write_page(folder / PAGE, name, track, folder / OVERLAY, quality, shown)
    write_json(folder / SUMMARY, summary)
    return written
