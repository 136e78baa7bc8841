"""The row of a finished take in the overview."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from apf.body.stature import is_whole, stature
from apf.evaluation.evaluate import Evaluation
from apf.report.drawing import Figure, draw_mosaic
from apf.report.quality import DOUBTFUL
from apf.report.summary import read_summary
from apf.tracking.take import Take
from apf.tracking.track import Track
from psfs.common.files import write_picture

THUMBNAIL = "thumbnail.jpg"
#: Width of a thumbnail, px; it shows the first camera.
_WIDTH = 240


@dataclass(frozen=True)
class TakeRow:
    """A track of a take.

    name: its folder in OUT. source: the take's folder. quality: verdict of the track's report.
    seconds: length of the take. limbs: lost ones if the truth is known, else parts with a low mean
    confidence in the report. confidence, misfit: means over the frames. height: of the body, m.
    mean_error: mm, if there is a truth. took: computing time, s. device, worker: that computed it.
    finished: time, UTC. parts: distances between the chunks of a long take where they are joined,
    mm. status, error: of a take that failed, which has no figures.
    """

    name: str
    source: str = ""
    status: str = "done"
    quality: str = ""
    frames: int | None = None
    seconds: float | None = None
    lost_frames: int | None = None
    limbs: str = ""
    confidence: float | None = None
    misfit: float | None = None
    height: float | None = None
    mean_error: float | None = None
    parts: str = ""
    took: float | None = None
    device: str = ""
    worker: str = ""
    finished: str = ""
    error: str = ""

    @classmethod
    def summarise(
        cls,
        name: str,
        folder: Path,
        take: Take,
        track: Track,
        found: Evaluation | None = None,
        **more: Any,
    ) -> TakeRow:
        """Build the row of one of the take's tracks, whose results are in `folder`. found: its
        evaluation, if there is a truth."""
        quality = read_summary(folder)["quality"]
        if found is not None:
            limbs = [limb for limb, lost in found.lost_limbs.items() if lost]
        else:
            believed = {part: of["mean_confidence"] for part, of in quality["parts"].items()}
            limbs = [
                part for part, mean in believed.items() if mean is not None and mean < DOUBTFUL
            ]
        return cls(
            name=name,
            source=str(take.sequence.folder),
            quality=quality["verdict"],
            frames=len(track),
            seconds=round(float(np.ptp(track.times)) + 1 / track.fps, 3),
            lost_frames=int(track.lost.sum()),
            limbs=", ".join(limbs),
            confidence=_mean(track.confidence),
            misfit=_mean(track.diagnostics.get("misfit", np.array([np.nan]))),
            height=round(stature(take.body), 3) if is_whole(take.body) else None,
            mean_error=round(1000 * found.mean_error, 1) if found else None,
            finished=f"{datetime.now(timezone.utc):%Y-%m-%d %H:%M:%S}",
            **more,
        )

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> TakeRow:
        """Build the row from plain values; unknown ones are ignored."""
        known = {field.name for field in fields(cls)}
        return cls(**{name: value for name, value in values.items() if name in known})

    def plain(self) -> dict[str, Any]:
        """Return the values by their names."""
        return asdict(self)


def write_thumbnail(folder: Path, take: Take, track: Track) -> None:
    """Write the middle frame of the first camera, with the body, into the folder of results."""
    frame = take.sequence.read(int(track.frames[len(track) // 2]))
    picture = draw_mosaic(frame, take.sequence.rig, [Figure(track)], views=[0])
    height = round(picture.shape[0] * _WIDTH / picture.shape[1])
    small = cv2.resize(picture, (_WIDTH, height), interpolation=cv2.INTER_AREA)
    write_picture(folder / THUMBNAIL, small)


def _mean(values: np.ndarray) -> float | None:
    known = values[np.isfinite(values)]
    return round(float(known.mean()), 3) if known.size else None
