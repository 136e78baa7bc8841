"""The stage `initialise`: estimate body and first pose from the first of a session's frames."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable

from apf.body.model import BodyModel
from apf.filters.config import FilterConfig
from apf.initialisation.automatic import find_start
from apf.initialisation.config import FrameChoice, StartConfig
from apf.initialisation.hypotheses import forward
from apf.initialisation.kept_voxels import store_voxels
from apf.initialisation.start import Start, StartError, check_startable
from apf.scene import Scene
from cl import InputError
from psfs.sequence import Sequence
from psfs.session import Session
from psfs.volume import automatic_grid

log = logging.getLogger(__name__)

#: Least frame rate, frames/s, at which a person can be tracked.
SLOWEST = 1.0


def initialise(
    session: Session,
    template: BodyModel,
    *,
    height: float | None = None,
    keep_shape: bool = False,
    seed: int = 0,
    progress: Callable[[], object] | None = None,
    config: StartConfig | None = None,
) -> Start:
    """Find the person in the first of the session's frames; see `find_start`.

    If another hypothesis fits nearly as well, more frames are used, where there are more: if the
    person wears a skirt, or holds the arms in front of the trunk, one second of footage hardly
    shows the heading.
    """
    config = config or StartConfig()

    def found(config: StartConfig) -> Start:
        return _find(
            session, template, config,
            height=height, keep_shape=keep_shape, seed=seed, progress=progress,
        )  # fmt: skip

    start = found(config)
    if start.rival >= config.acceptance.ambiguous:
        return start
    factor, frames = config.acceptance.longer, config.frames
    wider = frames.replace(duration=factor * frames.duration, n_fitted=2 * frames.n_fitted)
    if _count_fitted(session, wider) <= _count_fitted(session, frames):
        return start  # the take ends before
    try:
        again = found(config.replace(frames=wider))
    except StartError:
        return start
    turned = forward(start.body, start.pose) @ forward(again.body, again.pose) < 0
    if not turned or again.rival < start.rival:
        return start
    log.info(
        "%s: the person looks the other way, according to a search over more frames",
        session.sequence.name,
    )
    return again


def _find(
    session: Session,
    template: BodyModel,
    config: StartConfig,
    *,
    height: float | None,
    keep_shape: bool,
    seed: int,
    progress: Callable[[], object] | None,
) -> Start:
    """Find the person with these settings."""
    check_startable(template)  # before the voxels are carved
    device, chosen = session.device, session.frames
    sequence = session.sequence
    check_rate(sequence, chosen.step)
    grid = automatic_grid(session)
    carve = session.reconstructor(grid)
    frames, every = frames_to_fit(chosen, sequence.fps, config.frames)
    noise = FilterConfig().scale_to_rate(sequence.fps / frames.step).search.noise

    wanted = sequence.frames(slice(frames.start, frames.stop, frames.step))
    return find_start(
        Scene(device, sequence.rig, grid, template),
        [store_voxels(device, carve(frame)) for frame in wanted], noise,
        height=height, keep_shape=keep_shape, seed=seed, progress=progress, every=every,
        config=config,
    )  # fmt: skip


def check_rate(sequence: Sequence, step: int) -> None:
    """Raise InputError if every `step`-th frame of a sequence is too few to track a person."""
    fps = sequence.fps / abs(step)
    if fps < SLOWEST:
        raise InputError(
            f"{sequence.name}: {fps:g} frames per second to be tracked; expected at least "
            f"{SLOWEST:g}: people move too far in between"
        )


def _count_fitted(session: Session, config: FrameChoice) -> int:
    """Return how many of the session's frames the body is fitted to."""
    frames, every = frames_to_fit(session.frames, session.sequence.fps, config)
    return len(frames[::every])


def frames_to_fit(chosen: range, fps: float, config: FrameChoice) -> tuple[range, int]:
    """Return the first of the chosen frames that a start reconstructs, and the step between those
    that the body is fitted to."""
    apart = config.duration / config.n_fitted * fps / abs(chosen.step)
    skip = max(1, round(apart / (1 + config.n_between)))
    every = math.ceil(apart / skip)
    return chosen[: skip * ((config.n_fitted - 1) * every + 1) : skip], every
