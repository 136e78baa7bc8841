"""The report as one self-contained HTML page, of one person or of several: a player of the bodies,
the overlay, and, of a judged track, voxels, confidence, agreement and angles."""

from __future__ import annotations

import base64
import html
import json
from collections import defaultdict
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from apf.body.model import find_side, plain_name, sideless
from apf.body.stature import stature
from apf.report import PAGE
from apf.report.drawing import LOST, css, encode, make_figures
from apf.report.quality import DOUBTFUL, Quality
from apf.tracking.people import PeopleTracks, person_folder
from apf.tracking.track import Track, spans
from apf.tracking.uncertainty import angle_bands
from cl import InputError
from psfs.common.files import open_text, temporary_folder
from psfs.common.numbers import json_number
from psfs.output.video import write_video
from psfs.page.clouds import CONFIDENCE, choose_block_width, colour_voxels, merge_voxels

if TYPE_CHECKING:
    import av

#: Angles that most readers look for, shown first.
_FIRST_JOINTS = ("knee", "hip", "ankle")
#: About the most blocks of voxels in all frames together, and in one: 12 MB and 60 kB of page. More
#: would not be visible at the size of the player.
_MOST_VOXELS, _MOST_OF_A_FRAME = 400_000, 4_000
#: Most bytes of a video of up to `_SHORT` s, proportionally more for longer ones; and width, px, of
#: one that is reduced to that.
_BYTES, _SHORT, _WIDTH = 4_000_000, 60.0, 1280


def write_page(
    path: Path,
    name: str,
    tracks: PeopleTracks,
    video: Path,
    quality: Quality | None = None,
    facts: Mapping[str, object] | None = None,
) -> None:
    """Write the page of a take, titled `name`.

    video: the overlay, omitted if it does not exist. quality: of the only person. facts: the
    content of `summary.json`, and the text `settings`, of such a page. On a page of several people
    links lead to those of the persons, as far as they exist beside it. Raises InputError if the
    page cannot be written.
    """
    points = np.concatenate([track.joints.reshape(-1, 3) for track in tracks])
    figures = make_figures(tracks)
    people = [
        {**figure.pack(tracks.frames), **_describe_person(path.parent, tracks, number)}
        for number, figure in enumerate(figures)
    ]
    content = {
        "name": name,
        "frames": tracks.frames.tolist(),
        "fps": tracks[0].fps,
        "counts": tracks.counts.tolist(),
        "people": people,
        "lines": _count_people(tracks),
        "scene": {
            "low": (np.nanmin(points, axis=0) - 0.2).round(3).tolist(),
            "high": (np.nanmax(points, axis=0) + 0.2).round(3).tolist(),
            "lost_colour": css(LOST),
        },
        "video": base64.b64encode(encode_page_video(video)).decode() if video.exists() else None,
    }
    if quality is not None:
        content |= _judged_content(quality) | {"summary": facts}
    _write_filled(path, name, content)


def _judged_content(quality: Quality) -> dict[str, object]:
    agreement = quality.agreement
    content: dict[str, object] = {
        "verdict": quality.verdict,
        "lines": quality.lines(),
        "rows": quality.rows.tolist(),
        "look_at": {what: rows.tolist() for what, rows in quality.doubtful.items()},
        "angles": angle_curves(quality.track),
        "confidence": {
            "frames": _round(quality.track.confidence, 3),
            "parts": list(quality.parts),
            "values": [_round(values, 3) for values in quality.confidence.T],
            "scale": CONFIDENCE,
            "doubtful": DOUBTFUL,
        },
    }
    if agreement is not None:
        content["voxels"] = _pack_voxels(quality)
        content["agreement"] = {
            "cameras": list(agreement.cameras),
            "body": [_round(values, 3) for values in agreement.body_iou.T],
            "voxels": [_round(values, 3) for values in agreement.voxel_iou.T],
        }
    return content


def _count_people(tracks: PeopleTracks) -> list[str]:
    """Say how many people there are, and how many at a time."""
    counts = tracks.counts
    n_frames = {int(n): int((counts == n).sum()) for n in np.unique(counts)}
    at_once = ", ".join(f"{n} in {frames}" for n, frames in n_frames.items())
    lines = [f"{len(tracks)} people are followed; at a time: {at_once} of {len(counts)} frames"]
    if tracks.objects:
        verbs = "move are" if tracks.objects > 1 else "moves is"
        lines.append(f"{tracks.objects} more that {verbs} not followed")
    return lines


def _describe_person(folder: Path, tracks: PeopleTracks, number: int) -> dict[str, object]:
    """Return what the list of people says of one."""
    track, page = tracks.select_seen(number), person_folder(Path(), number + 1) / PAGE
    try:
        height = f"{stature(track.its_body):.2f} m"
    except InputError:  # only a part of the person is modelled
        height = "-"
    return {
        "page": page.as_posix() if (folder / page).exists() else None,
        "verdict": tracks.verdicts[number] or "unknown",
        "seen": spans(tracks.seen[number].tolist()),
        "lost": spans(track.frames[track.lost].tolist()) or "none",
        "height": height,
    }


def angle_curves(track: Track) -> dict[str, list[dict[str, Any]]]:
    """Return the curves of each joint's angles, degrees, None where lost (name, side, values (F,),
    band (F,)), those of the legs first.

    They are clinical angles, see `apf.body.angles`, or the body's own if it has none. band: see
    `angle_bands`; None where unknown.
    """
    groups = defaultdict[str, list[dict[str, Any]]](list)
    bands = angle_bands(track.its_body, track.poses, track.covariance)
    unknown = np.full(len(track), np.nan)
    for name, values in track.angles.items():
        side, (joint, *of) = find_side(name), sideless(name).split("_")
        band = np.where(np.isnan(values), np.nan, bands.get(name, unknown))
        curve = {"name": " ".join(of), "side": side, "values": _round(values, 1)}
        groups[joint].append(curve | {"band": _round(band, 1)})
    if not groups:
        for bone in track.its_body.bones:
            for axis in bone.axes:
                if axis.kind[0] == "r":
                    turned = np.degrees(np.unwrap(track.poses[:, axis.dof]))
                    known = _round(np.where(track.lost, np.nan, turned), 1)
                    curve = {"name": f"about {axis.kind[1]}", "side": "middle", "values": known}
                    groups[plain_name(bone.name)].append(curve | {"band": _round(unknown, 1)})
    first = [joint for joint in _FIRST_JOINTS if joint in groups]
    return {name: groups[name] for name in (*first, *groups)}


def _round(values: np.ndarray, digits: int) -> list[float | None]:
    """Round values (n,) for JSON: None for NaN."""
    return [json_number(value, digits) for value in values]


def _pack_voxels(quality: Quality) -> dict[str, object]:
    """Pack the voxels of all judged frames, merged into blocks of one size if they are many.

    Arrays are base64 of little-endian numbers: cells uint8 or uint16 (N, 3) of a grid with `origin`
    and `size` m, frame after frame by `counts`, and RGB uint8 (N, 3).
    """
    assert quality.agreement is not None
    clouds = quality.agreement.clouds
    most = min(_MOST_OF_A_FRAME, _MOST_VOXELS // max(1, len(clouds)))
    width = choose_block_width(max(len(cloud) for cloud in clouds), most)
    rng = np.random.default_rng(0)
    cells, colours = [], []
    for cloud in clouds:
        blocks, means = merge_voxels(cloud, colour_voxels(cloud), width)
        picked = rng.permutation(len(blocks))[:most]  # all of a surface
        cells.append(blocks[picked])
        colours.append(means[picked])
    grid = clouds[0].grid
    size = width * grid.voxel_size
    kind = "u1" if max(grid.shape) <= 256 * width else "<u2"
    return {
        "counts": [len(cell) for cell in cells],
        "bytes": 1 if kind == "u1" else 2,
        "cells": encode(np.concatenate(cells), kind),
        "colours": encode(np.concatenate(colours), "u1"),
        "origin": (grid.origin + size / 2).round(5).tolist(),
        "size": size,
    }


def encode_page_video(path: Path) -> bytes:
    """Return the video at `path` as MP4 with H.264; it is encoded again if it is not, or is too
    large.

    Raises InputError if it cannot be read.
    """
    import av  # slow to import

    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            seconds = float(stream.frames / (stream.average_rate or 25))
            allowed = _BYTES * max(1.0, seconds / _SHORT)
            if stream.codec_context.name == "h264" and path.stat().st_size <= allowed:
                return path.read_bytes()
            with temporary_folder() as folder:
                smaller = folder / "smaller.mp4"
                _encode(container, smaller, 0.9 * 8 * allowed / max(seconds, 0.1))
                return smaller.read_bytes()
    except (av.FFmpegError, IndexError) as error:
        raise InputError(f"{path}: cannot be read as a video: {error}") from None


def _encode(source: av.container.InputContainer, path: Path, bits_per_second: float) -> None:
    stream = source.streams.video[0]
    factor = min(1.0, _WIDTH / stream.width)
    size = (round(stream.width * factor), round(stream.height * factor))
    with write_video(path, float(stream.average_rate or 25), most=bits_per_second) as video:
        for frame in source.decode(stream):
            picture = frame.to_ndarray(format="bgr24")
            video.write(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))


def _write_filled(path: Path, name: str, content: dict[str, object]) -> None:
    from plotly.offline import get_plotlyjs  # slow to import

    text = json.dumps(content, allow_nan=False, separators=(",", ":"))
    parts = {
        "title": html.escape(name),
        "style": _text("page.css"),
        "plotly": get_plotlyjs(),
        "script": _text("page.js"),
        "content": text.replace("<", "\\u003c"),  # which could end the script that contains it
    }
    with open_text(path) as file:
        for number, piece in enumerate(_text("page.html").split("@@")):
            file.write(parts[piece] if number % 2 else piece)


def _text(name: str) -> str:
    return (resources.files("apf.report") / name).read_text(encoding="utf-8")
