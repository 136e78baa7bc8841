"""The page of a live run: the body as it is tracked, latency, dropped frames, the run's end."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from apf.body.kinematics import posed_joints
from apf.live.pace import describe_run
from apf.live.session import LiveResult, LiveStart
from apf.live.timeline import Timeline
from apf.report.drawing import make_still_figure
from apf.studio.body_nodes import BodyNodes
from psfs.cameras.camera import CameraRig
from psfs.page.nodes import CameraNodes, add_floor, box_around
from psfs.page.server import BrowserPage
from psfs.page.timeline import add_button, add_key
from psfs.page.words import make_lines, make_text

#: Most updates of the page per second.
_RATE = 30.0
_BEGIN = "record a take"


class LivePage(BrowserPage):
    """A page that shows the newest poses.

    start: who is tracked, and where they begin. rig: the cameras. stop: ends the run, as the page's
    button and the key X do.
    """

    def __init__(
        self,
        start: LiveStart,
        rig: CameraRig,
        stop: Callable[[], None],
    ) -> None:
        super().__init__("psfs-apf live", 0)
        self._run: tuple[LiveResult, Timeline] | None = None
        self._ended = threading.Event()
        gui, scene = self.server.gui, self.server.scene
        self.status: Any = gui.add_html(make_text("Waiting for the first pose."))
        #: Ends the run.
        self.press_end = stop
        hint = "key: X; what is tracked is kept"
        add_button(gui, "end the run", lambda: self.press_end(), hint=hint)
        hint = "key: R; a take of its own, in a folder take1, ..."
        self._record = add_button(gui, _BEGIN, self.press_record, hint=hint)
        self._takes: list[tuple[int, int]] = []
        self._began: int | None = None  # frame in which the take that is recorded began
        add_key(gui, "Begin or end a take", "R", self.press_record)
        add_key(gui, "End the run", "X", self.press_end)
        self.nodes = [
            BodyNodes(
                scene,
                f"/people/{k}",
                make_still_figure(body, pose, number=k if len(start.people) > 1 else None),
            )
            for k, (body, pose) in enumerate(start.people)
        ]
        for nodes in self.nodes:
            nodes.show(0, 0)
        CameraNodes(scene, rig)
        body, pose = start.people[0]
        joints, grid = posed_joints(body, pose[None])[0], start.grid
        add_floor(scene, box_around(joints) if grid is None else (grid.low, grid.high))
        centre = joints.mean(axis=0)
        self.server.initial_camera.look_at = centre
        self.server.initial_camera.position = centre + np.array([2.5, -3.0, 1.2])
        scene.set_up_direction("+z")
        self._thread = threading.Thread(target=self._work, daemon=True, name="live page")
        self._thread.start()

    def __call__(self, result: LiveResult, timeline: Timeline) -> None:
        """Show the newest pose of a run from now on; tracking does not wait for it."""
        self._run = result, timeline

    @property
    def takes(self) -> list[tuple[int, int]]:
        """The first and the last frame of each recorded take; one that is recorded ends now."""
        if self._began is None:
            return list(self._takes)
        return [*self._takes, (self._began, max(self._began, self._newest_frame))]

    @property
    def _newest_frame(self) -> int:
        frames = self._run[0].frames if self._run is not None else []
        return frames[-1] if frames else 0

    def press_record(self) -> None:
        """Begin a take with the next pose, or end the one that is recorded."""
        if self._began is None:
            self._began = self._newest_frame + 1
        else:
            self._takes, self._began = self.takes, None
        self._record.label = _BEGIN if self._began is None else "end this take"

    def close(self) -> None:
        """Draw the last pose, and end the server."""
        self._ended.set()
        self._thread.join(timeout=30)
        self.stop()

    def _work(self) -> None:
        shown = 0
        while True:
            ended = self._ended.wait(1 / _RATE)
            if self._run is not None and len(self._run[0].estimates) > shown:
                shown = len(self._run[0].estimates)
                self._show(*self._run)
            if ended:
                return

    def _show(self, result: LiveResult, timeline: Timeline) -> None:
        newest = result.newest
        with self.server.atomic():
            for nodes, estimate in zip(self.nodes, newest, strict=True):
                nodes.show_pose(estimate.pose)
        confidences = ", ".join(f"{estimate.confidence:.2f}" for estimate in newest)
        kind, words = "good", f"confidence {confidences}"
        n_lost = sum(estimate.lost for estimate in newest)
        if n_lost:
            kind, words = "warning", "the person is lost"
            if len(newest) > 1:
                words = f"{n_lost} of {len(newest)} people are lost"
        self.status.content = make_lines([(kind, words), ("note", describe_run(result, timeline))])
