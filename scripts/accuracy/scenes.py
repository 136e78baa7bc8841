"""Synthetic sequences that `accuracy.py` generates: the papers' conditions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from apf.synthetic.generate import generate
from apf.synthetic.scene import SceneConfig
from cl import Device
from psfs.cli.commandline import stderr

#: Diffuse light: a person's shadow is a fifth of that under two lamps.
_SOFT: dict[str, Any] = {"cameras": 4, "shadow": 0.2}
#: The thesis's own recordings: 4 cameras, 25 frames/s, pictures scaled to 480 x 270 (2.4).
_PJWSTK: dict[str, Any] = {"frames": 56, "fps": 25.0, "size": (480, 270), **_SOFT}
#: The papers' conditions (Rymut 2016, 2.4 and 6.7; LeeWalk: 640 x 480, 60 frames/s), by name: two
#: persons who walk straight at a camera (S) and on the diagonal (D), one who walks round, and one
#: of them in pictures of twice the width.
SOFT_SCENES: dict[str, SceneConfig] = {
    "soft_p1s": SceneConfig(seed=11, height=1.76, course="straight", **_PJWSTK),
    "soft_p1d": SceneConfig(seed=11, height=1.76, course="diagonal", **_PJWSTK),
    "soft_p2s": SceneConfig(seed=12, height=1.62, course="straight", **_PJWSTK),
    "soft_p2d": SceneConfig(seed=12, height=1.62, course="diagonal", **_PJWSTK),
    "soft_p1s_hd": SceneConfig(
        seed=11, height=1.76, course="straight", **{**_PJWSTK, "size": (960, 540)}
    ),
    "soft_round": SceneConfig(seed=13, height=1.70, frames=150, fps=60.0, **_SOFT),
}


def make_scenes(folder: Path, scenes: dict[str, SceneConfig], device: Device) -> list[Path]:
    """Return the folders of the scenes in `folder`, generated unless they exist."""
    folders = []
    for name, config in scenes.items():
        target = folder.resolve() / name
        if not target.exists():
            stderr.print(f"filming {target}")
            generate(target, config, device)
        folders.append(target)
    return folders
