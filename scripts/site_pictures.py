"""Make the pictures of README and site from a folder of `apf demo`: the animation, its steps, and
what the examples in docs/examples draw.

    apf demo -o demo --cameras 6
    python scripts/site_pictures.py demo
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from PIL import Image

from apf.body.kinematics import posed_cones
from apf.body.model import find_side
from apf.report.drawing import SIDES, Figure
from apf.tracking.track import Track
from psfs.output.preview import View, shade_points
from psfs.output.reconstruction_folder import ReconstructionFolder
from psfs.sequence import Frame, Sequence
from psfs.voxels.clouds import estimate_normals
from psfs.voxels.grid import VoxelCloud

OUT = Path(__file__).parents[1] / "docs" / "pictures"
#: Width and height of a panel of the animation, px.
PANEL = (270, 330)
#: Degrees that the viewer of the voxels walks around them per second.
_TURN = 30.0
#: Metres that a panel shows from its top to its bottom.
_TALL = 2.15
#: Every so many frames one is shown.
_STEP = 2
_INK, _PAPER = (60, 60, 60), (250, 250, 250)


class Demo:
    """Results of `apf demo`, frame by frame."""

    def __init__(self, folder: Path) -> None:
        self.sequence = Sequence.open(folder / "sequence")
        self.voxels = ReconstructionFolder.open(folder / "voxels")
        self.track = Track.open(folder / "track" / "track.npz")
        self.cones = posed_cones(self.track.its_body, self.track.poses)

    def crop(self, row: int) -> tuple[slice, slice]:
        """Return rows and columns of the first camera's picture around the person."""
        camera = self.sequence.rig[0]
        pixels, _ = camera.project(self.track.joints[row])
        middle = (pixels.min(0) + pixels.max(0)) / 2
        tall = 1.35 * np.ptp(pixels[:, 1])
        half = np.array([tall * PANEL[0] / PANEL[1], tall]) / 2
        low = np.clip(middle - half, 0, np.array(camera.size) - 2 * half).astype(int)
        high = (low + 2 * half).astype(int)
        return slice(low[1], high[1]), slice(low[0], high[0])


def draw_picture(demo: Demo, frame: Frame, row: int, body: bool) -> np.ndarray:
    """Draw the first camera's picture around the person, with the tracked body if `body`."""
    picture = frame.images[0]
    if body:
        picture = picture.copy()
        Figure(demo.track).draw(picture, demo.sequence.rig[0], row)
    return cv2.resize(picture[demo.crop(row)], PANEL, interpolation=cv2.INTER_AREA)


def view_person(joints: np.ndarray, azimuth: float) -> View:
    """Return a view from `azimuth`, degrees, with the person of joints (J, 3) m in its middle."""
    around = View.fit(joints, 0.0, azimuth, 12.0, PANEL)
    centre = np.array([*np.median(joints[:, :2], axis=0), 0.47 * _TALL])
    return View(around.axes, centre, PANEL[1] / _TALL, np.array(PANEL) / 2)


def draw_voxels(cloud: VoxelCloud, view: View) -> np.ndarray:
    """Draw a cloud in its colours."""
    normals, edge = estimate_normals(cloud), cloud.grid.voxel_size
    return shade_points(cloud.centres, normals, cloud.colour, edge, view, PANEL)


def draw_skeleton(voxels: np.ndarray, track: Track, row: int, view: View) -> np.ndarray:
    """Draw the skeleton on faded `voxels`, a drawing of the same view."""
    drawn = cv2.addWeighted(voxels, 0.3, np.full_like(voxels, 255), 0.7, 0)
    pixels, depth = view.project(track.joints[row])
    points = [tuple(int(value) for value in point) for point in np.rint(pixels * 16)]
    for a, b in sorted(track.edges, key=lambda edge: -depth[edge].mean()):
        sides = {find_side(track.joint_names[a]), find_side(track.joint_names[b])} - {"middle"}
        colour = SIDES[sides.pop() if sides else "middle"][::-1]
        cv2.line(drawn, points[a], points[b], colour, 5, cv2.LINE_AA, 4)
    for point in points:
        cv2.circle(drawn, point, 3 * 16, _INK, -1, cv2.LINE_AA, 4)
    return drawn


def draw_strip(panels: dict[str, np.ndarray]) -> np.ndarray:
    """Draw panels beside each other, each above its name."""
    columns = []
    for name, panel in panels.items():
        label = np.full((26, PANEL[0], 3), _PAPER, np.uint8)
        width = cv2.getTextSize(name, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)[0][0]
        place = ((PANEL[0] - width) // 2, 18)
        cv2.putText(label, name, place, cv2.FONT_HERSHEY_SIMPLEX, 0.5, _INK, 1, cv2.LINE_AA)
        columns.append(np.vstack([panel, label]))
    return np.hstack(columns)


def draw_frames(demo: Demo) -> list[np.ndarray]:
    """Draw the frames of the animation: picture, voxels, skeleton."""
    strips = []
    rows = range(0, len(demo.track), _STEP)
    frames = demo.sequence.select_frames([int(demo.track.frames[row]) for row in rows])
    for row, frame in zip(rows, frames, strict=True):
        view = view_person(demo.track.joints[row], -60 + _TURN * row / demo.track.fps)
        voxels = draw_voxels(demo.voxels.cloud(frame.index), view)
        strips.append(
            draw_strip(
                {
                    f"one of {len(demo.sequence.rig)} cameras": draw_picture(
                        demo, frame, row, False
                    ),
                    "voxels": voxels,
                    "skeleton": draw_skeleton(voxels, demo.track, row, view),
                    "body in the picture": draw_picture(demo, frame, row, True),
                }
            )
        )
    return strips


def write_animation(strips: list[np.ndarray], path: Path, fps: float) -> None:
    """Write an animated WebP that repeats for ever."""
    images = [Image.fromarray(strip[..., ::-1]) for strip in strips]
    images[0].save(
        path, save_all=True, append_images=images[1:], duration=round(1000 / fps), loop=0,
        quality=60, method=6,
    )  # fmt: skip


def draw_examples(sequence: Path) -> None:
    """Run the examples with `sequence` as their walk, and keep the pictures that they draw."""
    examples = OUT.parent / "examples"
    names = re.findall(r'"examples/(\w+)\.py"', (OUT.parent / "python.md").read_text())
    with TemporaryDirectory() as folder:
        (Path(folder) / "walk").symlink_to(sequence.resolve())
        for name in names:  # in the page's order: some read what those before them wrote
            environment = os.environ | {"MPLBACKEND": "agg"}
            command = [sys.executable, str(examples / f"{name}.py")]
            subprocess.run(command, cwd=folder, env=environment, check=True)
        for picture in Path(folder).glob("*.png"):
            shutil.copy(picture, OUT)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("demo", type=Path, help="folder of `apf demo`")
    folder = parser.parse_args().demo
    demo = Demo(folder)
    OUT.mkdir(exist_ok=True)
    strips = draw_frames(demo)
    write_animation(strips, OUT / "walk.webp", demo.track.fps / _STEP)
    cv2.imwrite(str(OUT / "steps.jpg"), strips[len(strips) // 2], [cv2.IMWRITE_JPEG_QUALITY, 85])
    draw_examples(folder / "sequence")
    for path in sorted(OUT.iterdir()):
        print(f"{path.name}: {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
