"""The stage `initialise`: estimate body and poses from the first of a session's frames."""

from __future__ import annotations

from collections.abc import Callable

from apf.body.model import BodyModel
from apf.filters.config import FilterConfig
from apf.initialisation.automatic import find_start
from apf.initialisation.kept_voxels import store_voxels
from apf.initialisation.start import Start, StartConfig, check_startable
from apf.scene import Scene
from cl import InputError
from psfs.sequence import Sequence
from psfs.session import Session
from psfs.volume import automatic_grid

#: Least frame rate, frames/s, at which a person can be tracked.
SLOWEST = 1.0


def initialise(
    session: Session,
    template: BodyModel,
    *,
    height: float | None = None,
    keep_shape: bool = False,
    with_rival: bool = True,
    seed: int = 0,
    progress: Callable[[], object] | None = None,
) -> Start:
    """Find the person in the first of the session's frames; see `find_start`."""
    config = StartConfig()
    check_startable(template)  # before the voxels are carved
    device, sequence = session.device, session.sequence
    check_rate(sequence, session.frames.step)
    grid = automatic_grid(session)
    carve = session.reconstructor(grid)
    frames = frames_to_fit(session.frames, sequence.fps, config)
    noise = FilterConfig().scale_to_rate(sequence.fps / abs(frames.step)).search.noise
    wanted = sequence.frames(slice(frames.start, frames.stop, frames.step))
    return find_start(
        Scene(device, sequence.rig, grid, template),
        [store_voxels(device, carve(frame)) for frame in wanted], noise,
        frames=frames, height=height, keep_shape=keep_shape, with_rival=with_rival, seed=seed,
        progress=progress, config=config,
    )  # fmt: skip


def check_rate(sequence: Sequence, step: int) -> None:
    """Raise InputError if every `step`-th frame of a sequence is too few to track a person."""
    fps = sequence.fps / abs(step)
    if fps < SLOWEST:
        raise InputError(
            f"{sequence.name}: {fps:g} frames per second to be tracked; expected at least "
            f"{SLOWEST:g}: people move too far in between"
        )


def frames_to_fit(chosen: range, fps: float, config: StartConfig) -> range:
    """Return those of the first of the chosen frames that a start is fitted to."""
    n = max(1, round(config.duration * fps / abs(chosen.step)))
    return chosen[: n + 1 : max(1, round(n / config.n_frames))][: config.n_frames]
