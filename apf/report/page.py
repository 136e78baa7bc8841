"""Write the report as one self-contained HTML page with scripts, data and video."""

from __future__ import annotations

import base64
import html
import json
from importlib import resources
from pathlib import Path

from apf.report.curves import agreement_curves, angle_curves, confidence_curves
from apf.report.film import encode_page_video
from apf.report.player import player_scene
from apf.report.quality import DOUBTFUL, Quality
from psfs.common.files import open_text


def write_page(
    path: Path, name: str, quality: Quality, summary: dict[str, object], settings: str, video: Path
) -> None:
    """Write the page of a track.

    summary: of `summary.json`. settings: the text of settings.toml. video: the overlay, omitted if
    it does not exist. Raises InputError if the page cannot be written.
    """
    track = quality.track
    content = {
        "name": name,
        "verdict": quality.verdict,
        "lines": quality.lines(),
        "frames": track.frames.tolist(),
        "rows": quality.rows.tolist(),
        "fps": track.fps,
        "lost": track.lost.astype(int).tolist(),
        "doubtful_below": DOUBTFUL,
        "look_at": {what: rows.tolist() for what, rows in quality.doubtful.items()},
        "scene": player_scene(quality),
        "confidence": confidence_curves(quality),
        "agreement": agreement_curves(quality),
        "angles": angle_curves(track),
        "summary": summary,
        "settings": settings,
        "video": base64.b64encode(encode_page_video(video)).decode() if video.exists() else None,
    }
    write_filled_page(path, name, "page", content)


def write_filled_page(path: Path, name: str, kind: str, content: dict[str, object]) -> None:
    """Write a page of the kind `page` or `people`, titled `name`, with its `content`. Raises
    InputError if it cannot be written."""
    from plotly.offline import get_plotlyjs  # slow to import

    parts = {
        "title": html.escape(name),
        "style": _text("page.css"),
        "plotly": get_plotlyjs(),
        "script": _text("common.js") + _text(f"{kind}.js"),
        "content": _escape_for_script(content),
    }
    with open_text(path) as file:
        for number, piece in enumerate(_text(f"{kind}.html").split("@@")):
            file.write(parts[piece] if number % 2 else piece)


def _text(name: str) -> str:
    return (resources.files(__package__) / name).read_text(encoding="utf-8")


def _escape_for_script(content: dict[str, object]) -> str:
    """Return JSON that cannot end the script element that contains it."""
    text = json.dumps(content, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
