"""The stage `initialise`: estimate body and first pose from the first of a session's frames."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import numpy as np

from apf.body.model import BodyModel
from apf.body.stature import is_whole
from apf.filters.config import FilterConfig
from apf.initialisation.automatic import find_start
from apf.initialisation.config import FrameChoice, StartConfig
from apf.initialisation.hypotheses import forward
from apf.initialisation.kept_voxels import StoredVoxels, select_person_points, store_voxels
from apf.initialisation.shape_fit import seen_heights
from apf.initialisation.start import Start, StartError, check_startable
from apf.scene import Scene
from cl import InputError
from psfs.sequence import Frame, Sequence
from psfs.session import Session
from psfs.volume import automatic_grid
from psfs.voxels.device_voxels import Voxels
from psfs.voxels.host_voxels import HostVoxels

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

    If the person stoops or crouches there and stands taller in a later frame, the body is fitted
    around that frame, because a visual hull does not show the length of bent limbs.
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

    def shown(frames: range) -> list[StoredVoxels | HostVoxels]:
        wanted = sequence.frames(slice(frames.start, frames.stop, frames.step))
        return [store_voxels(device, carve(frame)) for frame in wanted]

    def found(
        voxels: list[StoredVoxels | HostVoxels], body: BodyModel, own_shape: bool = False
    ) -> Start:
        scene = Scene(device, sequence.rig, grid, body)
        return find_start(
            scene, voxels, noise, height=height, keep_shape=own_shape, seed=seed,
            progress=progress, every=every, config=config,
        )  # fmt: skip

    def tall(frame: Frame) -> float:
        if progress is not None:
            progress()
        return seen_height(carve(frame), config)

    first = shown(frames)
    heights = [seen_height(voxels, config) for voxels in first]
    if keep_shape or not is_whole(template) or not heights[0]:
        return found(first, template, keep_shape)
    least = config.frames.taller * max(heights)
    begun = chosen.index(frames[-1])
    upright = _tallest(sequence, chosen[begun + 1 :], tall, least, config.frames.n_looks)
    if upright is None:
        return found(first, template, keep_shape)
    around = chosen[max(0, chosen.index(upright) - begun // 2) :]
    try:
        standing = found(shown(frames_to_fit(around, sequence.fps, config.frames)[0]), template)
    except StartError:
        return found(first, template, keep_shape)
    log.info("%s: measured about frame %d, where the person stands", sequence.name, upright)
    start = found(first, standing.body, own_shape=True)
    return replace(start, seen=standing.seen, girth=standing.girth)


def _tallest(
    sequence: Sequence, frames: range, tall: Callable[[Frame], float], least: float, n_looks: int
) -> int | None:
    """Return the frame with the greatest height `tall` out of `n_looks` evenly spaced `frames`;
    None if none reaches `least`. A frame that cannot be read ends the search; tracking reports the
    error."""
    n = min(n_looks, len(frames))
    picked = [frames[round(k)] for k in np.linspace(0, len(frames) - 1, n)]
    heights = dict[int, float]()
    with suppress(InputError), sequence.reader(learning=False) as read:
        for index in picked:
            heights[index] = tall(read(index))
    best = max(heights, key=heights.__getitem__, default=None)
    return best if best is not None and heights[best] >= least else None


def seen_height(voxels: Voxels | StoredVoxels | HostVoxels, config: StartConfig) -> float:
    """Return the height, m, of the visible part of the person; 0 if nobody is there."""
    points = select_person_points(voxels.grid, voxels.cloud().indices, config.frames)
    if len(points) < config.frames.min_voxels:
        return 0.0
    _, (low, high) = seen_heights(points, config.shape)
    return high - low


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
