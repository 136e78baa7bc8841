"""The stages `judge_track` and `write`: a track judged, its summary and page written beside it.

A track is judged by motion, too, that people do not make: long walks backward, falls faster than
gravity's, steps that are too fast for the legs. The first comes from a start that faced the wrong
way, the others from a frame rate that is stated too high. The ground pushes and does not pull, so
the centre of mass accelerates downward by at most g; at twice the rate accelerations are four times
as high. Legs swing as pendulums: at a speed v people take 0.87 Fr^0.2 sqrt(g / L) steps per second,
Fr = v^2 / (g L), since a stride is 2.3 Fr^0.3 legs long (Alexander 1989, "Optimization and gaits in
the locomotion of vertebrates").
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from collections.abc import Sequence as Items
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.constants import g as GRAVITY

from apf.body.surface import paint
from apf.evaluation.joint_names import match_joints
from apf.keypoints.keypoints import Keypoints
from apf.report import FILES, OVERLAY, PAGE
from apf.report.agreement import Agreement, compare_with_silhouettes, measure_keypoint_agreement
from apf.report.page import write_page
from apf.report.quality import Quality
from apf.report.summary import SUMMARY, body_facts, read_tracked_grid
from apf.tracking.gait import measure_gait
from apf.tracking.people import PeopleTracks
from apf.tracking.track import Track
from psfs.common.files import read_text, write_json
from psfs.common.numbers import pick_evenly
from psfs.session import Session

#: The factor and the power of that law; and the least Fr at which it is asked: slower people may
#: dance.
_STEPS, _POWER, _WALKS_ON = 0.87, 0.2, 0.5
#: Limits of what people do, who walk, run, dance, lunge and kick: least share backward of all that
#: is walked, in lunges 0.3; least downward acceleration of the centre of mass that nobody has, in
#: g, 1 for a point mass, in a kick, whose mass is estimated, 1.25; least steps per second that
#: nobody takes, as a multiple of that law's, at a frame rate stated twice too high 1.5.
_BACKWARD, _FALL, _MOST_STEPS = 0.75, 1.5, 1.25
#: Standard deviation, s, of the filter of joints, velocities and accelerations.
_WINDOW = 0.05
#: Share of the body's mass of the segments between two joints, of each side (Winter 2009, table
#: 4.1; hands are counted with forearms, feet with shanks). The rest is trunk and head.
_LIMBS = (
    ("shoulder", "elbow", 0.028),
    ("elbow", "wrist", 0.022),
    ("hip", "knee", 0.100),
    ("knee", "ankle", 0.061),
)
_TRUNK, _HEAD = 0.497, 0.081
_JOINTS = {"neck", "head_top"} | {
    f"{side}_{end}" for side in "lr" for first, last, _ in _LIMBS for end in (first, last)
}


def find_impossible_motion(track: Track) -> list[str]:
    """Return what people do not do, a line each; nothing for a body without arms, legs or head.
    Frames in which the person is lost are not judged."""
    columns = match_joints(track.joint_names)
    if not columns.keys() >= _JOINTS or len(track) < 3:
        return []
    joints = np.where(track.lost[:, None, None], np.nan, track.joints)
    points = {name: joints[:, column] for name, column in columns.items()}
    legs = [
        np.linalg.norm(points[f"{side}_{a}"] - points[f"{side}_{b}"], axis=1)
        for side in "lr"
        for a, b in (("hip", "knee"), ("knee", "ankle"))
    ]
    if not np.isfinite(legs).any():
        return []
    leg = 0.5 * float(np.nansum(np.nanmedian(legs, axis=1)))
    lines = [
        _find_backward_walk(track, points, leg),
        _find_fast_fall(track, points),
    ]
    if not lines[1]:
        lines.append(_find_fast_steps(track, joints, leg))
    return [text for text in lines if text]


def _find_backward_walk(track: Track, points: dict[str, np.ndarray], leg: float) -> str | None:
    """Return a line if most of the path leads backward, by more than a leg's length."""
    pelvis = 0.5 * (points["l_hip"] + points["r_hip"])
    velocity = _smooth_derivative(pelvis, track.times, _WINDOW, 1)[:, :2]
    ahead = np.cross(points["l_hip"] - points["r_hip"], [0.0, 0.0, 1.0])[:, :2]
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1), 1e-9)[:, None]
    seconds = np.gradient(track.times)
    along = np.nan_to_num(np.einsum("fa,fa->f", velocity, ahead)) * seconds
    backward = float(-along[along < 0].sum())
    total = float(np.nansum(np.linalg.norm(velocity, axis=1) * seconds))
    if backward < max(leg, _BACKWARD * total):
        return None
    return (
        f"the person walks backward ({backward:.1f} m of {total:.1f} m); expected somebody who "
        "faces where they go: if they did, the start faced the wrong way"
    )


def _find_fast_fall(track: Track, points: dict[str, np.ndarray]) -> str | None:
    """Return a line if the centre of mass accelerates downward by more than gravity in one frame of
    twenty."""
    trunk = 0.5 * (points["neck"] + 0.5 * (points["l_hip"] + points["r_hip"]))
    mass = _TRUNK * trunk + _HEAD * points["head_top"]
    for first, last, share in _LIMBS:
        for side in "lr":
            mass = mass + share * 0.5 * (points[f"{side}_{first}"] + points[f"{side}_{last}"])
    fall = -_smooth_derivative(mass, track.times, _WINDOW, 2)[:, 2]
    known = fall[np.isfinite(fall)]
    if len(known) < 60:  # three frames: a single frame's jump is no fall
        return None
    greatest = float(np.quantile(known, 0.95))
    if greatest < _FALL * GRAVITY:
        return None
    return (
        f"the body accelerates downward by {greatest / GRAVITY:.1f} times gravity; expected at "
        f"most 1: {track.fps:g} frames per second may be too high"
    )


def _find_fast_steps(track: Track, joints: np.ndarray, leg: float) -> str | None:
    """Return a line if the steps are faster than legs of this length, m, swing at this speed."""
    filtered = [
        _smooth_derivative(points, track.times, 0.5 * _WINDOW, 0)
        for points in joints.swapaxes(0, 1)
    ]
    if not np.isfinite(filtered).all():  # hardly any frame is known
        return None
    gait = measure_gait(replace(track, joints=np.stack(filtered, 1)))
    if gait is None:
        return None
    froude, steps = gait.speed**2 / (GRAVITY * leg), gait.cadence / 60
    most = _MOST_STEPS * _STEPS * froude**_POWER * np.sqrt(GRAVITY / leg)
    if froude < _WALKS_ON or steps < most:
        return None
    return (
        f"the person takes {steps:.1f} steps per second at {gait.speed:.1f} m/s; expected at most "
        f"{most:.1f} with legs of {leg:.2f} m: {track.fps:g} frames per second may be too high"
    )


def _smooth_derivative(
    points: np.ndarray, times: np.ndarray, width: float, order: int
) -> np.ndarray:
    """Return a derivative (F, 3) of points (F, 3) at times (F,) s, after a Gaussian filter with a
    standard deviation of `width` s; of the second NaN within two of them of the ends."""
    from scipy.ndimage import gaussian_filter1d  # takes a while to load

    known = np.isfinite(points).all(1)
    if known.sum() < 3:
        return np.full(points.shape, np.nan)
    step = float(np.median(np.diff(times)))
    even = np.arange(times[0], times[-1] + step / 2, step)
    columns = [np.interp(even, times[known], axis) for axis in points[known].T]
    sigma = max(width / step, 0.8)
    derivative = gaussian_filter1d(np.stack(columns, 1), sigma, axis=0, order=order, mode="nearest")
    derivative /= step**order
    if order > 1:
        rim = int(np.ceil(2 * sigma))
        derivative[:rim], derivative[max(len(derivative) - rim, 0) :] = np.nan, np.nan
    return np.stack([np.interp(times, even, axis) for axis in derivative.T], 1)


def judge_track(
    session: Session,
    track: Track,
    progress: Callable[[], object] = lambda: None,
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
