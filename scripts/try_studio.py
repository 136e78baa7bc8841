"""Work through the page of `apf studio` as a new user would, in a headless Chromium.

Opens a take, tracks some of its frames, plays the track, puts a wrist that was turned away on
purpose right by clicks in two pictures, tracks again, and saves a BVH; with a screenshot of each
step, light and dark. Without a take it presses "a walk to try", and works on the demo's walk.
Prints the wrist's error against the take's truth.npz before and after, as JSON.

With --first it is a new user's first try: `apf studio` on the folder that holds the take, and from
then on only what is seen on the page, to a BVH. Prints each step with its seconds.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from apf.body.kinematics import posed_joints
from apf.evaluation.evaluate import load_truth
from apf.studio.folders import Roots
from apf.studio.page import Page
from apf.tracking.track import Track
from cl import InputError, select_device
from psfs.page.look_through import find_fov

_BROWSER = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
#: Angles, rad, by which the left arm is turned away.
_TURNED = {"l_upper_arm.rx": 1.3, "l_upper_arm.ry": -0.8, "l_forearm.ry": -1.0}
_LONGEST = 600.0  # s, of a step


class Trial:
    """A browser's tab on the page, and the folder of its screenshots."""

    def __init__(self, page: Page, tab: Any, shots: Path) -> None:
        self.page, self.tab, self._shots, self._n_shots = page, tab, shots, 0

    def click(self, name: str, role: str = "button") -> None:
        """Click what a user would see under this name."""
        self.tab.get_by_role(role, name=name, exact=True).first.click()

    def wait(self, done: Callable[[], bool], what: str) -> None:
        """Wait until `done`. Raises InputError if that takes too long."""
        until = time.monotonic() + _LONGEST
        while not done():
            if time.monotonic() > until:
                raise InputError(f"{what}: not done after {_LONGEST:g} s; expected sooner")
            self.tab.wait_for_timeout(500)

    def shoot(self, name: str) -> None:
        """Take a screenshot."""
        self.tab.wait_for_timeout(4000)
        self._n_shots += 1
        path = self._shots / f"{self._n_shots}_{name}.png"
        self.tab.screenshot(path=path, timeout=300_000)
        self.page.dark.value = True
        self.tab.wait_for_timeout(2000)
        self.tab.screenshot(path=path.with_stem(f"{path.stem}_dark"), timeout=300_000)
        self.page.dark.value = False

    def click_in_picture(self, view: int, point: np.ndarray) -> None:
        """Look through a camera, and click where its picture shows a point (3,) m."""
        watch = self.page.watch
        assert watch is not None and watch.opened.sequence is not None
        camera = watch.opened.sequence.rig[view]
        watch.through.value = camera.name
        self.tab.wait_for_timeout(4000)
        box = self.tab.locator("canvas").first.bounding_box()
        client = next(iter(self.page.server.get_clients().values()))
        x, y, depth = camera.R @ point + camera.t
        focal = box["height"] / 2 / np.tan(find_fov(camera, client) / 2)
        self.tab.mouse.click(
            box["x"] + box["width"] / 2 + focal * x / depth,
            box["y"] + box["height"] / 2 + focal * y / depth,
        )
        self.tab.wait_for_timeout(1000)

    def track(self, frames: str) -> Path:
        """Track frames of the footage that is open by the buttons; return the run's folder."""
        self.click("Run", "tab")
        find_field(self.tab, "frames").fill(frames)
        self.tab.keyboard.press("Enter")
        self.wait(lambda: self.page.run.frames.value == frames, "the field of frames")
        self.click("track")
        return self.finish()

    def finish(self) -> Path:
        """Wait until a run that was just started has ended; return its folder."""
        run = self.page.run
        self.wait(lambda: run.work is not None and not run.work.ended, "start of the run")
        work = run.work
        assert work is not None
        self.wait(lambda: work.ended and not run.cancel_button.visible, "the run")
        if not work.succeeded:
            raise InputError(f"the run ended early: {'; '.join(work.words)}; expected a track")
        return work.output


def find_field(tab: Any, label: str) -> Any:
    """Return the field of a browser's tab that has this label."""
    row = tab.locator(f"label:text-is('{label}')").first
    return row.locator("xpath=ancestor::div[contains(@class, 'Flex')][1]").locator("input")


def turn_arm_away(folder: Path) -> tuple[int, np.ndarray]:
    """Turn the left arm of a track away in its middle third; return the middle row and the rows."""
    track = Track.open(folder)
    body, poses, n = track.its_body, track.poses.copy(), len(track)
    rows = np.arange(n // 3, max(n // 3 + 1, 2 * n // 3))
    for name, angle in _TURNED.items():
        dof = body.dof_names.index(name)
        poses[rows, dof] = np.clip(poses[rows, dof] + angle, body.lower[dof], body.upper[dof])
    replace(track, poses=poses, joints=posed_joints(body, poses)).save(folder / "track.npz")
    return int(rows[len(rows) // 2]), rows


def wrist_error(folder: Path, take: Path, rows: np.ndarray) -> float:
    """Return the mean error of the left wrist in rows of a track, mm."""
    track, truth = Track.open(folder), load_truth(take / "truth.npz")
    ours = track.joints[rows, track.joint_names.index("l_wrist")]
    true = truth.joints[track.frames[rows], list(truth.joint_names).index("l_wrist")]
    return round(1000 * float(np.linalg.norm(ours - true, axis=1).mean()), 1)


def make_demo(trial: Trial) -> Path:
    """Press the button that makes the demo's walk; return the walk's folder, which is open then."""
    page = trial.page
    trial.click("a walk to try")
    trial.wait(lambda: page.footage is not None, "the demo's walk")
    assert page.footage is not None
    return page.footage.sequence.folder


def work_through(trial: Trial, take: Path, frames: str) -> dict[str, Any]:
    """Do all steps; return the wrist's errors and the size of the BVH."""
    page, tab = trial.page, trial.tab
    tab.get_by_text("frame 0 ·").wait_for()
    for notice in tab.locator("button.mantine-Notification-closeButton").all():
        notice.click()  # of software rendering, which covers tabs
    trial.wait(lambda: "examining" not in page.footage.remarks, "the examination")  # type: ignore[union-attr]
    trial.shoot("footage")
    run = trial.track(frames)
    trial.click("Watch", "tab")
    trial.shoot("tracked")
    trial.click("play")
    trial.wait(lambda: page.watch is not None and page.watch.time_line.n_shown > 5, "playing")
    tab.keyboard.press("Home")
    as_tracked = Track.open(run)
    row, rows = turn_arm_away(run)
    errors = {"turned_away": wrist_error(run, take, rows)}
    page.open(run)
    assert page.watch is not None
    page.watch.time_line.seek(row)
    trial.click("Correct", "tab")
    page.correct.joint.value = "l_wrist"
    page.correct.way.value = "clicking it in two pictures"
    trial.click("put it right in this frame")
    truth = load_truth(take / "truth.npz")
    number = list(truth.joint_names).index("l_wrist")
    for view in (0, 1):
        trial.click_in_picture(view, truth.joints[int(as_tracked.frames[row]), number])
    trial.wait(lambda: page.correct.place.label != "put it right in this frame", "the handle")
    trial.shoot("clicked")
    trial.click("it is right there now")
    trial.wait(lambda: "left wrist" in page.correct.list, "the correction")
    trial.click("track again")
    again = trial.finish()
    trial.shoot("corrected")
    as_tracked.save(run / "track.npz")
    errors |= {
        "corrected": wrist_error(again, take, rows),
        "as_tracked": wrist_error(run, take, rows),
    }
    trial.click("Take home", "tab")
    with tab.expect_download() as saved:
        trial.click("save")
    return {
        "wrist_error_mm": errors,
        "saved": saved.value.suggested_filename,
        "bytes": Path(saved.value.path()).stat().st_size,
    }


def try_first(folder: Path, name: str, frames: str, output: Path) -> list[tuple[str, float]]:
    """Do what a new user does from `apf studio FOLDER` to a BVH of the take `name`, by the page
    alone; return the steps with the seconds that each took."""
    from playwright.sync_api import sync_playwright

    steps, began = [], time.monotonic()

    def note(step: str) -> None:
        nonlocal began
        now = time.monotonic()
        steps.append((step, round(now - began, 1)))
        began = now

    words = ["studio", str(folder), "-o", str(output / "results"), "--no-browser", "--port", "0"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with (
        subprocess.Popen(
            [sys.executable, "-m", "apf.cli", *words],
            stdout=subprocess.PIPE, text=True, env=environment,
        ) as studio,
        sync_playwright() as running,
    ):  # fmt: skip
        assert studio.stdout is not None
        address = studio.stdout.readline().split()[0]
        browser = running.chromium.launch(executable_path=shutil.which("chromium"), args=_BROWSER)
        tab = browser.new_page(viewport={"width": 1200, "height": 700}, accept_downloads=True)
        tab.set_default_timeout(1000 * _LONGEST)
        tab.goto(address)
        tab.get_by_text("Choose a folder to open.").wait_for()
        note("apf studio, the page is there")
        tab.locator("input[value='(choose)']").first.click()
        tab.get_by_role("option", name=f"{name} (footage)", exact=True).click()
        tab.get_by_text("whole", exact=True).wait_for()  # the table, once the footage is examined
        tab.screenshot(path=output / "first_1_footage.png")
        note("open: the take; cameras, volume, what was found")
        tab.get_by_role("tab", name="Run").click()
        find_field(tab, "frames").fill(frames)
        tab.keyboard.press("Enter")
        tab.get_by_role("button", name="track", exact=True).click()
        tab.get_by_role("button", name="cancel").wait_for()
        tab.get_by_role("button", name="cancel").wait_for(state="hidden")
        tab.screenshot(path=output / "first_2_tracked.png")
        note("Run, track: until the track is shown")
        tab.get_by_role("tab", name="Watch").click()
        tab.get_by_role("button", name="play", exact=True).click()
        tab.wait_for_timeout(3000)
        tab.get_by_role("button", name="first", exact=True).click()
        note("Watch, play")
        tab.get_by_role("tab", name="Take home").click()
        with tab.expect_download() as saved:
            tab.get_by_role("button", name="save", exact=True).click()
        size = Path(saved.value.path()).stat().st_size
        tab.screenshot(path=output / "first_3_home.png")
        note(f"Take home, save: {saved.value.suggested_filename}, {size} bytes")
        browser.close()
        studio.terminate()
    return steps


def main() -> None:
    """Work through the page on a take, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "take", type=Path, nargs="?", help="folder of a take with truth.npz (default: the demo's)"
    )
    parser.add_argument("--frames", default="0:45")
    parser.add_argument("-o", "--output", type=Path, required=True, help="runs and screenshots")
    parser.add_argument("--first", action="store_true", help="a new user's first try")
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    if args.first:
        if args.take is None:
            parser.error("--first needs a take")
        for step, seconds in try_first(args.take.parent, args.take.name, args.frames, args.output):
            print(f"{seconds:6.1f} s  {step}")
        return
    from playwright.sync_api import sync_playwright

    folder = args.take or args.output
    page = Page(Roots(folder), lambda: select_device("auto"), results=args.output / "results")
    if args.take is not None:
        page.open(args.take)
    with sync_playwright() as running:
        browser = running.chromium.launch(executable_path=shutil.which("chromium"), args=_BROWSER)
        tab = browser.new_page(viewport={"width": 1200, "height": 640}, accept_downloads=True)
        tab.set_default_timeout(90_000)
        tab.goto(page.address)
        trial = Trial(page, tab, args.output)
        take = args.take or make_demo(trial)
        print(json.dumps(work_through(trial, take, args.frames)))
        browser.close()
    page.stop()


if __name__ == "__main__":
    main()
