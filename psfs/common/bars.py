"""Bars of progress, which the process that has started a command can follow, too."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import RenderableType
from rich.progress import Progress

#: Variable of the environment that names the file into which a command states its progress.
PROGRESS = "PSFS_PROGRESS"


class StatedProgress(NamedTuple):
    """What a command is doing: in words, the share of it that is done (0 to 1), and the expected
    time until its end, s (None: not known)."""

    words: str = ""
    share: float = 0.0
    left: float | None = None

    @classmethod
    def read(cls, file: Path) -> StatedProgress:
        """Read what a command has stated, nothing before it has."""
        with suppress(OSError, ValueError, TypeError):
            return cls(*json.loads(file.read_text(encoding="utf-8")))
        return cls()


class FollowedProgress(Progress):
    """Bars of which the last one is also stated in the file of the environment, if it names one.

    A task's field `end` may say at which time since its beginning the command is expected to end,
    s. Nothing is left of bars without progress, and after an error, whose message is to stand
    alone.
    """

    def __exit__(self, exc_type: Any, exc_val: Any, exc_tb: Any) -> None:
        self.live.transient = exc_type is not None
        self.stop()

    def stop(self) -> None:
        """Stop showing the bars."""
        self.live.transient |= not any(task.completed for task in self.tasks)
        if self.live.transient:
            self.live.stop()  # without the empty line that `stop` writes into a file
        else:
            super().stop()

    def get_renderable(self) -> RenderableType:
        if (file := os.environ.get(PROGRESS)) and self.tasks:
            task = self.tasks[-1]
            end = task.fields.get("end")
            left = None if end is None else max(0.0, end - (task.elapsed or 0.0))
            stated = StatedProgress(task.description, task.percentage / 100, left)
            with suppress(OSError):  # the other process has ended
                written = Path(f"{file}.new")
                written.write_text(json.dumps(stated), encoding="utf-8")
                written.replace(file)
        return super().get_renderable()
