"""Times for `asv`, on the CPU's OpenCL: the frame of `apf timings`, and what it consists of."""

from __future__ import annotations

from itertools import islice
from typing import Any

from apf.timings.measure import cpu_place
from apf.timings.scene import WholeFrame, make_problem, playing


class Frame:
    """From pictures to voxels and pose: 8 cameras of 640 x 480, 2.25 million voxels."""

    timeout = 900
    warmup_time = 0.0
    number = processes = 1
    repeat = (3, 20, 10.0)

    def setup(self) -> None:
        self.problem = make_problem(6)
        self.whole = WholeFrame(cpu_place().device(), self.problem)
        self.frames = playing(self.problem.scene.frames)
        for frame in islice(self.frames, 3):  # kernels are built
            self.estimate: Any = self.whole(frame)[0]

    def time_frame(self) -> None:
        self.whole(next(self.frames))

    def time_reconstruction(self) -> None:
        self.whole.reconstruct(next(self.frames)).cloud()

    def track_joint_error(self) -> float:
        """Mean distance to the truth of the frames of the setup, mm."""
        return self.problem.error_mm(2, self.estimate.pose)

    track_joint_error.unit = "mm"  # type: ignore[attr-defined]
