"""Measure how fast the page of `apf studio` opens and plays: its own scene, a headless Chromium.

Prints the seconds until the page can be asked for and until a browser shows it, frames per second
that the server sends while playing, those that the browser draws, processor seconds of all that
(which others on the machine change little), and the memory of this process. Without a browser only
the server is measured. "coarse" says whether the page came to show fewer, larger voxels while
playing, as it does by itself where a browser draws slowly.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from scipy.ndimage import binary_erosion

from apf.studio.folders import Roots
from apf.studio.page import Page
from cl import NumpyDevice
from psfs.output.reconstruction_folder import cloud_stem, grid_facts
from psfs.voxels.clouds import write_npz
from psfs.voxels.config import ReconstructionConfig
from psfs.voxels.grid import VoxelCloud, VoxelGrid

_GRID = VoxelGrid(np.array([-1.5, -1.5, 0.0]), 0.01, (300, 300, 200))
_BROWSER = ["--no-sandbox", "--enable-unsafe-swiftshader"]
#: Time in which the page finds out how fast the browser draws, s; it is not counted.
_FIRST_S = 6.0
#: Counts the frames that the page draws.
_COUNT_DRAWN = """() => { window.drawn = 0;
    const tick = () => { window.drawn += 1; requestAnimationFrame(tick); };
    requestAnimationFrame(tick); }"""


def write_scene(folder: Path, n_frames: int, n_voxels: int) -> None:
    """Write a ball's surface of about `n_voxels` that moves over the floor, as psfs reconstruct
    does."""
    (folder / "clouds").mkdir(parents=True)
    frames, radius = [], float(np.sqrt(n_voxels / 10.3))  # voxels
    around = np.stack(np.meshgrid(*[np.arange(-radius - 1, radius + 2)] * 3, indexing="ij"), -1)
    inside = np.linalg.norm(around, axis=-1) < radius
    surface = around[inside & ~binary_erosion(inside)]
    colour = np.clip(128 + 120 * surface / radius, 0, 255).astype(np.uint8)
    for number in range(n_frames):
        phase = 2 * np.pi * number / 200
        centre = np.array([150 + 50 * np.cos(phase), 150 + 50 * np.sin(phase), 90])
        cells = np.floor(surface + centre).astype(int)
        indices = np.ravel_multi_index(tuple(cells.T), _GRID.shape).astype(np.int32)
        cloud = VoxelCloud(_GRID, indices, np.ones(len(indices), np.float32), colour)
        write_npz(cloud, cloud_stem(folder, number).with_suffix(".npz"))
        frames.append({"index": number, "surface_voxels": len(indices), "volume_m3": 0.9})
    summary = {
        "sequence": {"absolute": str(folder / "none"), "overrides": {}, "fps": 60.0},
        "grid": grid_facts(_GRID),
        "config": ReconstructionConfig().to_dict(),
        "frames": frames,
    }
    (folder / "summary.json").write_text(json.dumps(summary))


def measure(folder: Path, seconds: float) -> dict[str, Any]:
    """Open and play a folder for some seconds; return the figures by name."""
    process, began, cpu = psutil.Process(), time.perf_counter(), time.process_time()
    page = Page(Roots(folder), NumpyDevice)
    page.open(folder)
    found: dict[str, Any] = {
        "opening_s": round(time.perf_counter() - began, 2),
        "opening_cpu_s": round(time.process_time() - cpu, 2),
    }
    path = shutil.which("chromium")
    try:
        if path is None:
            return found | _play(page, seconds, None)
        from playwright.sync_api import sync_playwright

        with sync_playwright() as running:
            browser = running.chromium.launch(executable_path=path, args=_BROWSER)
            tab = browser.new_page(viewport={"width": 800, "height": 450})
            began = time.perf_counter()
            tab.goto(page.address)
            tab.get_by_text("frame 0 ·").wait_for(timeout=120_000)
            found["browser_shows_s"] = round(time.perf_counter() - began, 2)
            found["browser_shows_cpu_s"] = round(_browser_seconds(), 2)
            found |= _play(page, seconds, tab)
            browser.close()
        return found
    finally:
        found["memory_mb"] = round(process.memory_info().rss / 2**20)
        page.stop()


def _play(page: Page, seconds: float, tab: Any) -> dict[str, Any]:
    """Play for some seconds; return frames per second, of the server and of the browser's tab."""
    assert page.watch is not None
    line = page.watch.time_line
    {key: do for _, key, do in line.list_keys()}["space"]()
    if tab is not None:
        tab.wait_for_timeout(1000 * _FIRST_S)
        tab.evaluate(_COUNT_DRAWN)
    drawn, browser = 0, _browser_seconds()
    cpu, began, shown = time.process_time(), time.perf_counter(), line.n_shown
    if tab is None:
        time.sleep(seconds)
    else:
        tab.wait_for_timeout(1000 * seconds)
        drawn = tab.evaluate("() => window.drawn")
    passed = time.perf_counter() - began
    found: dict[str, Any] = {
        "coarse": page.watch.coarse,
        "frames_per_s": round((line.n_shown - shown) / passed, 1),
        "server_cpu_s_per_frame": round(
            (time.process_time() - cpu) / max(1, line.n_shown - shown), 4
        ),
    }
    if tab is None:
        return found
    browser = _browser_seconds() - browser
    return found | {
        "drawn_per_s": round(drawn / passed, 1),
        "browser_cpu_s_per_drawn": round(browser / max(1, drawn), 4),
    }


def _browser_seconds() -> float:
    """Return the processor time of all processes that this one started, s."""
    seconds = 0.0
    for child in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):
            times = child.cpu_times()
            seconds += times.user + times.system
    return seconds


def main() -> None:
    """Write the scene, measure, and print the figures as JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--voxels", type=int, default=30_000)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--scene", type=Path, help="folder of the scene, which is kept")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.scene or Path(temporary) / "scene"
        if not folder.exists():
            write_scene(folder, args.frames, args.voxels)
        print(json.dumps(measure(folder, args.seconds)))


if __name__ == "__main__":
    main()
