"""Judge a track, and write its summary and page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from apf.report.agreement import Agreement, measure_agreement
from apf.report.names import PAGE
from apf.report.page import write_page
from apf.report.quality import Quality
from apf.report.summary import SUMMARY, body_facts, read_tracked_grid
from apf.tracking.track import Track
from cl import Device, NumpyDevice
from psfs.common.files import read_text, write_json
from psfs.common.versions import versions
from psfs.output.runs import device_facts
from psfs.reconstructor import ReconstructionConfig
from psfs.sequence import Sequence

OVERLAY = "overlay.mp4"
#: Files of a track besides summary and page, as the summary lists them.
FILES = (
    "track.npz", "joints.trc", "joints.csv", "body.toml", "start.txt", "settings.toml", OVERLAY,
)  # fmt: skip


def judge_track(
    device: Device | NumpyDevice,
    sequence: Sequence,
    track: Track,
    config: ReconstructionConfig,
    progress: Callable[[], object] | None = None,
) -> Quality:
    """Judge the quality of a track.

    It is compared with the silhouettes, unless it has no frames or was tracked without voxels.
    progress: called after each compared frame.
    """
    grid = read_tracked_grid(track)
    found: Agreement | None = None
    if grid is not None and len(track):
        found = measure_agreement(device, sequence, grid, config, track, progress)
    return Quality(track, found)


def write_report(
    folder: Path, name: str, quality: Quality, facts: Mapping[str, Any], page: bool = True
) -> list[str]:
    """Write summary.json, and the `page`, into the `folder` of a track.

    Returns the names of all files there that belong to the track. facts: how it was made, see
    `run_facts`. name: of the take, the page's title.
    """
    written = [file for file in FILES if (folder / file).exists()]
    written += [SUMMARY, *([PAGE] if page else [])]
    summary = {
        **facts,
        "body": body_facts(quality.track.its_body),
        "quality": quality.facts(),
        "says": quality.lines(),
        "files": written,
    }
    if page:
        settings = folder / "settings.toml"
        text = read_text(settings, "settings") if settings.exists() else ""
        write_page(folder / PAGE, name, quality, summary, text, folder / OVERLAY)
    write_json(folder / SUMMARY, summary)
    return written


def run_facts(
    device: Device | NumpyDevice,
    sequence: Mapping[str, Any],
    config: ReconstructionConfig,
    n_frames: tuple[int, int],
    warnings: list[str],
    seconds: float,
) -> dict[str, Any]:
    """Describe how a track was made.

    sequence: from `sequence_facts`. n_frames: tracked and requested frames. seconds: run time.
    """
    return {
        "complete": n_frames[0] == n_frames[1],
        "frames": n_frames[0],
        "frames_wanted": n_frames[1],
        "sequence": dict(sequence),
        "config": config.to_dict(),
        "device": device_facts(device),
        "versions": versions(),
        "seconds": round(seconds, 2),
        "warnings": warnings,
    }
