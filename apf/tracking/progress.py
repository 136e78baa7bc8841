"""The progress of a take through the stages of its tracking."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable

log = logging.getLogger(__name__)


class StageProgress(ABC):
    """Receiver of a take's progress: called with the name of the current stage, see `track_take`,
    after every frame of stages that work by frames; and of what there is to tell, which is logged
    unless a subclass shows it."""

    def __init__(self) -> None:
        self._n_frames, self._whose, self._stage = 0, "", ""
        self._done: Counter[str] = Counter()

    @property
    def n_frames(self) -> int:
        """Number of frames of the track. Setting it begins another track, as of the next person."""
        return self._n_frames

    @n_frames.setter
    def n_frames(self, number: int) -> None:
        self._n_frames, self._whose = number, ""
        self._done.clear()

    def begin_person(self, n_frames: int, number: int, of: int) -> None:
        """Begin the track of one of several people, counted from 1."""
        self.n_frames = n_frames
        self._whose = f"person {number} of {of}: " if of > 1 else ""

    @abstractmethod
    def __call__(self, stage: str) -> None:
        """Report that a stage goes on, or has finished a frame."""

    def begin(self, stage: str) -> None:
        """Begin a stage, before its first frame."""
        self._done[stage] = 0
        self._enter(stage)

    @abstractmethod
    def _enter(self, stage: str) -> None:
        """Make a stage the current one; it goes on where it left off."""

    def warn(self, text: str) -> None:
        """Tell of a fault."""
        log.warning(text)

    def note(self, text: str) -> None:
        """Tell what was guessed."""
        log.info(text)

    def tell(self, text: str) -> None:
        """Tell what was found."""
        log.info(text)


class StageCalls(StageProgress):
    """Progress that calls `report` with the name of the stage."""

    def __init__(self, report: Callable[[str], object] | None = None) -> None:
        super().__init__()
        self._report = report

    def __call__(self, stage: str) -> None:
        if self._report is not None:
            self._report(stage)

    def _enter(self, stage: str) -> None:
        pass
