"""The page and the overlay of several people together."""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from apf.body.stature import stature
from apf.report.film import encode_page_video
from apf.report.names import PAGE
from apf.report.overlay import (
    check_indices,
    compose_mosaic,
    draw_overlay,
    frame_rate,
    posed_shown_cones,
)
from apf.report.page import write_filled_page
from apf.report.player import encode
from apf.tracking.people import PeopleTracks, person_folder
from apf.tracking.track import spans
from cl import InputError
from psfs.cameras.camera import Camera
from psfs.output.video import write_video
from psfs.sequence import Sequence

#: Colours of the people, RGB; they repeat.
PEOPLE_COLOURS = (
    (47, 111, 181), (217, 102, 31), (61, 155, 82), (147, 85, 176), (192, 57, 43), (122, 92, 62),
    (211, 107, 166), (93, 109, 126),
)  # fmt: skip
#: Share of white in the colours over pictures, which would be too dark.
_LIGHTER = 0.35


def write_people_page(folder: Path, name: str, tracks: PeopleTracks, video: Path) -> Path:
    """Write `report.html` of all people into `folder` and return its path.

    video: the overlay, omitted if it does not exist. Links lead to the pages of the persons, where
    they exist. Raises InputError if the page cannot be written.
    """
    points = np.concatenate([track.joints.reshape(-1, 3) for track in tracks])
    counts = tracks.counts
    content = {
        "name": name,
        "lines": _lines(tracks),
        "frames": tracks.frames.tolist(),
        "fps": tracks[0].fps,
        "counts": counts.tolist(),
        "scene": {
            "low": (np.nanmin(points, axis=0) - 0.2).round(3).tolist(),
            "high": (np.nanmax(points, axis=0) + 0.2).round(3).tolist(),
        },
        "people": [_person(folder, tracks, number) for number in range(len(tracks))],
        "video": base64.b64encode(encode_page_video(video)).decode() if video.exists() else None,
    }
    path = folder / PAGE
    write_filled_page(path, name, "people", content)
    return path


def _lines(tracks: PeopleTracks) -> list[str]:
    """Say how many people there are, and how many at a time."""
    counts = tracks.counts
    n_frames = {int(n): int((counts == n).sum()) for n in np.unique(counts)}
    at_once = ", ".join(f"{n} in {frames}" for n, frames in n_frames.items())
    lines = [f"{len(tracks)} people are followed; at a time: {at_once} of {len(counts)} frames"]
    if tracks.objects:
        verbs = "move are" if tracks.objects > 1 else "moves is"
        lines.append(f"{tracks.objects} more that {verbs} not followed")
    return lines


def _person(folder: Path, tracks: PeopleTracks, number: int) -> dict[str, object]:
    """Return what the page shows of one person: joints (F, J, 3) m, NaN where not seen, packed."""
    track, seen = tracks.select_seen(number), np.isin(tracks.frames, tracks.seen[number])
    joints = np.full((len(tracks.frames), *track.joints.shape[1:]), np.nan)
    joints[np.isin(tracks.frames, track.frames)] = track.joints
    own = person_folder(folder, number + 1)
    try:
        height = f"{stature(track.its_body):.2f} m"
    except InputError:  # only a part of the person is modelled
        height = "-"
    return {
        "name": own.name,
        "colour": "#{:02x}{:02x}{:02x}".format(*person_colour(number)),
        "page": f"{own.name}/{PAGE}" if (own / PAGE).exists() else None,
        "verdict": tracks.verdicts[number] or "unknown",
        "seen": spans(tracks.seen[number].tolist()),
        "lost": spans(track.frames[track.lost].tolist()) or "none",
        "height": height,
        "joint_names": list(track.joint_names),
        "edges": track.edges.tolist(),
        "joints": encode(joints, "<f4"),
        "shown": seen.astype(int).tolist(),
    }


def person_colour(number: int) -> tuple[int, int, int]:
    """Return the colour, RGB, of the person with a `number` from 0 on."""
    return PEOPLE_COLOURS[number % len(PEOPLE_COLOURS)]


@dataclass(frozen=True, eq=False)
class DrawnPerson:
    """One person as drawn: posed cones (C, 16) with names, joints (J, 3) m, joint pairs (E, 2), and
    the colour, BGR; None for the colours of the body's sides."""

    cones: np.ndarray
    names: list[str]
    joints: np.ndarray
    edges: np.ndarray
    colour: tuple[int, int, int] | None

    def draw_over(self, image: np.ndarray, camera: Camera) -> np.ndarray:
        """Return a copy of the image with the person."""
        return draw_overlay(
            image, camera, self.cones, self.names, self.joints, self.edges, colour=self.colour
        )


def write_people_overlay(
    path: str | Path,
    sequence: Sequence,
    tracks: PeopleTracks,
    progress: Callable[[], object] | None = None,
) -> None:
    """Write an mp4 of all cameras with everybody, each in their colour, near people over far ones.

    progress: called after each frame. Raises InputError if a frame is not in the sequence or the
    video cannot be written.
    """
    shown = [tracks.select_seen(number) for number in range(len(tracks))]
    cones = [posed_shown_cones(track.body, track) for track in shown]
    rows = [{int(frame): row for row, frame in enumerate(track.frames)} for track in shown]
    with write_video(path, frame_rate(tracks[0])) as video:
        for frame in sequence.select_frames(check_indices(sequence, tracks.frames)):
            people = [
                DrawnPerson(
                    cones[number][0][row := rows[number][frame.index]],
                    cones[number][1],
                    track.joints[row],
                    track.edges,
                    light_colour(number),
                )
                for number, track in enumerate(shown)
                if frame.index in rows[number]
                and np.isfinite(track.joints[rows[number][frame.index]]).any()
            ]
            video.write(compose_mosaic(frame, sequence.rig, partial(draw_everybody, people)))
            if progress is not None:
                progress()


def draw_everybody(people: list[DrawnPerson], image: np.ndarray, camera: Camera) -> np.ndarray:
    """Return a copy of the image with all people, the farthest first."""
    away = [-float(np.linalg.norm(np.nanmean(p.joints, 0) - camera.centre)) for p in people]
    for k in np.argsort(away):
        image = people[k].draw_over(image, camera)
    return image


def light_colour(number: int) -> tuple[int, int, int]:
    """Return the colour, BGR, of a person over pictures."""
    red, green, blue = (round(c + _LIGHTER * (255 - c)) for c in person_colour(number))
    return blue, green, red
