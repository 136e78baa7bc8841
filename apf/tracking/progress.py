"""The progress of a take through the stages of its tracking."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter


class StageProgress(ABC):
    """Receiver of a take's progress: called with the name of the current stage, see `track_take`,
    after every frame of stages that work by frames."""

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
