"""The stage `people`: how many people a take shows, who is who, and where each is: which
trajectories belong to one person, and which are people at all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from psfs.backend import make_evidence_pipeline
from psfs.common.numbers import STEP_SECONDS, select_span
from psfs.common.progress import map_in_threads
from psfs.diagnostics.small_views import Shrink, compute_ahead
from psfs.people.coarse_voxels import CoarseFrame, CoarseVoxels, measure_similarity
from psfs.people.following import (
    APART,
    LOWEST,
    PRESENT,
    REACH,
    SPEED,
    TALL,
    Trajectory,
    count_at_once,
    count_heads,
    find_middle,
    follow,
)
from psfs.sequence import Frame
from psfs.session import Session, check_frames
from psfs.silhouettes.config import SilhouetteConfig
from psfs.volume import VOLUME_MARGIN, Volume, find_volume
from psfs.voxels.body_prior import TrackedBody
from psfs.voxels.grid import VoxelGrid

#: A trajectory that begins so soon, s, after another one's end, and nearer than two people can be,
#: goes on with it, whatever its colours.
_SOON = 0.5
#: Least similarity (Bhattacharyya coefficient) of the colours of two trajectories of one person.
_LIKENESS = 0.45
#: Least volume of a second person, as share of the largest one's: a child of 1.15 m beside a tall
#: man has 0.28.
_LEAST_SHARE = 0.2
#: Frames that measure the height of a trajectory, and the share of them in which somebody may
#: crouch.
_LOOKS, _CROUCHING = 15, 0.8


def count_voxels(one: Trajectory) -> float:
    """Return the median number of voxels."""
    return float(np.median([len(of) for of in one.voxels.values()])) if one.voxels else 0.0


def join_returning(ones: Sequence[Trajectory], grid: VoxelGrid, fps: float) -> list[Trajectory]:
    """Join trajectories of one person who left and came back, or was lost for some frames: the
    most alike first, until none is left."""
    ones = sorted(ones, key=lambda one: int(one.frames[0]))
    while True:
        costs = np.full((len(ones), len(ones)), np.inf)
        for i, early in enumerate(ones):
            for j, late in enumerate(ones):
                if early.frames[-1] < late.frames[0]:
                    costs[i, j] = _measure_cost(early, late, grid, fps)
        if not np.isfinite(costs).any():
            return ones
        i, j = divmod(int(costs.argmin()), len(ones))
        joined, other = ones[i], ones.pop(j)
        joined.voxels.update(other.voxels)
        joined.colours.update(other.colours)


def _measure_cost(early: Trajectory, late: Trajectory, grid: VoxelGrid, fps: float) -> float:
    """Return how unlike both are, infinity where they cannot be the same person."""
    last, first = int(early.frames[-1]), int(late.frames[0])
    seconds = (first - last) / fps
    ends = grid.centres(early.voxels[last]), grid.centres(late.voxels[first])
    apart = float(np.linalg.norm(find_middle(ends[0]) - find_middle(ends[1])))
    if apart > SPEED * seconds + REACH:
        return np.inf
    alike = measure_similarity(early.sum_colours(), late.sum_colours())
    at_once = seconds < _SOON and apart < APART
    return 1 - alike if at_once or alike >= _LIKENESS else np.inf


def is_person(one: Trajectory, grid: VoxelGrid, largest: float) -> bool:
    """Return whether a trajectory is a second person beside one of `largest` volume."""
    low = np.median(_find_ends(one, grid)[:, 0]) <= LOWEST
    return bool(low and count_voxels(one) >= _LEAST_SHARE * largest and is_tall(one, grid))


def is_tall(one: Trajectory, grid: VoxelGrid) -> bool:
    """Return whether a trajectory is as high as a person in a fifth of its frames: a trolley, a
    ball or a dog never are, and people who crouch stand up at some time."""
    low, high = _find_ends(one, grid).T
    return bool(np.quantile(high - low, _CROUCHING) + grid.voxel_size >= TALL)


def _find_ends(one: Trajectory, grid: VoxelGrid) -> np.ndarray:
    """Return the lowest and highest voxel (_LOOKS, 2), m, in frames all over a trajectory."""
    picked = one.frames[np.linspace(0, len(one.frames) - 1, _LOOKS).round().astype(int)]
    heights = [grid.centres(one.voxels[int(index)])[:, 2] for index in picked]
    return np.array([(of.min(), of.max()) for of in heights])


def find_present_frames(one: Trajectory) -> np.ndarray:
    """Return the frames (F,) in which enough of the person is seen."""
    least = PRESENT * count_voxels(one)
    return np.array([index for index in one.frames if len(one.voxels[int(index)]) >= least], int)


#: Longest side, px, of the pictures that people are counted in; frames per second in which they are
#: counted and their colours compared, and twice as many in which they are followed.
_LONGEST_SIDE, _RATE = 480, 5.0


@dataclass(frozen=True, eq=False)
class Person:
    """One person: the frames (F,) that show enough of them, and their coarse voxels by frame, as
    flat indices, in some of these and perhaps others. colours: a histogram (BANDS, LEVELS^3), see
    `CoarseVoxels.measure_colours`; None without pictures."""

    frames: np.ndarray
    voxels: dict[int, np.ndarray]
    colours: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class StandingPeople:
    """Where people stand in `frames` (F,), ascending: x, y and height of the top (F, P, 3) m of
    each, NaN where they are not seen."""

    frames: np.ndarray
    positions: np.ndarray

    def find(self, number: int) -> np.ndarray:
        """Return the positions (P, 3) in a frame, or in the nearest one."""
        return self.positions[int(np.abs(self.frames - number).argmin())]


@dataclass(frozen=True, eq=False)
class People:
    """The people in `frames`, the largest first, in coarse voxels of `grid`; `objects`: the number
    of other things that move; `at_once`: how many stand in most frames, whoever they are."""

    frames: range
    grid: VoxelGrid
    persons: tuple[Person, ...]
    objects: int = 0
    at_once: int = 0

    @property
    def misses_somebody(self) -> bool:
        """Whether most frames show more than could be followed."""
        return self.at_once > self._followed_at_once + self.objects

    @property
    def _followed_at_once(self) -> int:
        """How many of the people most frames show."""
        return int(np.median(self.counts)) if len(self.frames) else 0

    def __len__(self) -> int:
        return len(self.persons)

    def __iter__(self) -> Iterator[Person]:
        return iter(self.persons)

    def find_positions(self) -> StandingPeople:
        """Return where the people stand in each frame."""
        positions = np.full((len(self.frames), len(self), 3), np.nan)
        for number, person in enumerate(self):
            for row, frame in enumerate(self.frames):
                if frame in person.voxels:
                    points = self.grid.centres(person.voxels[frame])
                    middle = find_middle(points)
                    about = np.linalg.norm(points[:, :2] - middle, axis=1) < APART
                    top = points[about, 2].max() + self.grid.voxel_size / 2
                    positions[row, number] = *middle, top
        known = np.any(np.all(np.isfinite(positions), axis=-1), axis=1)
        return StandingPeople(np.array(self.frames)[known], positions[known])

    @property
    def counts(self) -> np.ndarray:
        """Number (F,) of people in each of `frames`."""
        seen = [np.isin(self.frames, person.frames) for person in self.persons]
        return np.sum([np.zeros(len(self.frames), int), *seen], axis=0)

    def during(self, frames: range) -> People:
        """Return those who are seen in `frames`, there alone."""
        limited = [
            Person(
                person.frames[np.isin(person.frames, frames)],
                {index: voxels for index, voxels in person.voxels.items() if index in frames},
                person.colours,
            )
            for person in self.persons
        ]
        persons = tuple(person for person in limited if len(person.frames))
        return replace(self, frames=frames, persons=persons)

    def box(self, margin: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Return the lowest and highest corner (3,), m, of the box around everybody's voxels, and
        `margin` m around it."""
        points = [self.grid.centres(np.concatenate(list(p.voxels.values()))) for p in self]
        everything = np.concatenate(points)
        return everything.min(0) - margin, everything.max(0) + margin

    def describe(self) -> str:
        """Say how many there are, in words."""
        n = len(self)
        text = "one person is seen" if n == 1 else f"{n or 'no'} people are seen"
        if n > 1 and not (self.counts == n).all():
            text += f", {int(self.counts.min())} to {int(self.counts.max())} at a time"
        if self.misses_somebody:
            text = (
                f"{self.at_once} people are seen at once in most frames, and "
                f"{self._followed_at_once} can be followed from frame to frame; are the frames "
                "consecutive? Else give one moment at a time (--frames 4:5)"
            )
        if self.objects:
            verbs = "move are no people" if self.objects > 1 else "moves is no person"
            text += f"; {self.objects} more that {verbs}"
        return text


def count_people(session: Session, number: int | None = None) -> People:
    """Return the people in some of the session's frames. number: see `follow_people`."""
    every = max(1, round(session.rate / _RATE))
    return session.compute_once(
        (count_people, number), lambda: _Search(session, every, number).run()
    )


def follow_people(session: Session, number: int | None = None) -> People:
    """Return the people in all of the session's frames.

    number: how many there are, if that is known: the largest so many. Raises InputError if no frame
    is selected.
    """

    def follow() -> People:
        every = max(1, round(session.rate / (2 * _RATE)))
        people = _Search(session, every, number).run()
        frames = np.array(session.frames)
        rows = np.minimum((np.arange(len(frames)) + every // 2) // every, len(people.frames) - 1)
        nearest = np.array(people.frames)[rows]
        persons = [
            replace(person, frames=frames[np.isin(nearest, person.frames)]) for person in people
        ]
        return replace(people, frames=session.frames, persons=tuple(persons))

    return session.compute_once((follow_people, number), follow)


def follow_several(session: Session, number: int | None = None) -> People | None:
    """Return the people in all of the session's frames, also a single person beside an object that
    moves; None if there is one person alone, or `number`, of `follow_people`, is 1."""
    if number == 1:
        return None
    counted = count_people(session) if number is None else None
    if counted is not None and len(counted) + counted.objects < 2:
        return None
    people = follow_people(session, number)
    return people if len(people) and len(people) + people.objects > 1 else None


def extend_to_people(session: Session, body: TrackedBody | None = None) -> None:
    """Extend the volume, unless one is stated, to all of several people: those of a track, or those
    who are counted. The volume that is found by itself holds the largest of each frame."""
    box = _box_of_several(session, body)
    if box is None:
        return
    found, (low, high) = find_volume(session), box
    margin = VOLUME_MARGIN * (high - low)
    session.replace_result(
        find_volume,
        Volume(np.minimum(found.low, low - margin), np.maximum(found.high, high + margin)),
    )


def _box_of_several(
    session: Session, body: TrackedBody | None
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the box around several people; None of a single one, or if a volume is stated."""
    sequence = session.sequence
    if sequence.volume is not None:
        return None
    if body is not None:
        return body.box() if body.several else None
    if sequence.subject != "person" or len(session.rig) < 2:
        return None
    people = count_people(session)
    return people.box() if len(people) > 1 else None


class _Search:
    """The search for people in every `every`-th frame of a session."""

    def __init__(self, session: Session, every: int, number: int | None) -> None:
        self.session, self.number = session, number
        self.frames = check_frames(session)[::every]
        self.rate = session.rate / every
        shrink = Shrink(session.rig, session.rig.factor_within(_LONGEST_SIDE))
        self._shrink = shrink
        self._begin = make_evidence_pipeline(
            session.device, shrink.small, shrink.background(session.background),
            SilhouetteConfig().without_memory(),
        )  # fmt: skip
        self.space = CoarseVoxels(shrink.small, session.sequence.volume, session.reconstruction)

    def run(self) -> People:
        """Return the people."""
        shown = [(frame.index, counts.copy()) for frame, counts in self._look(self.frames)]
        frames = list(map_in_threads(lambda each: self.space(*each), shown))
        heads = count_heads(frames, self.space.grid) if self.number is None else None
        people = self._find(frames, self.number or heads)
        if heads is not None and len(people) < heads:  # what was split is one person
            return self._find(frames, None)
        return replace(people, at_once=count_at_once(frames, self.space.grid))

    def _find(self, frames: list[CoarseFrame], number: int | None) -> People:
        """Return the people in frames: `number` of them, if that is known."""
        grid, fps = self.space.grid, self.session.sequence.fps
        everything = follow(frames, grid, self.rate, number)
        lasting = min(STEP_SECONDS * self.rate, len(frames) / 2)
        found = [one for one in everything if len(one.voxels) >= max(2, lasting / 2)] or everything
        if len(found) < 2:
            return People(self.frames, grid, tuple(map(self._person, found)))
        self._observe(found)
        found = join_returning(found, grid, fps)
        ranked = sorted(found, key=lambda one: count_voxels(one) * len(one.voxels), reverse=True)
        largest = next((one for one in ranked if is_tall(one, grid)), ranked[0])
        rest = [one for one in ranked if one is not largest and len(one.voxels) >= lasting]
        chosen = [one for one in rest if is_person(one, grid, count_voxels(largest))]
        if self.number is not None:
            others = [one for one in rest if one not in chosen]
            chosen = [*chosen, *others][: self.number - 1]
        persons = tuple(map(self._person, (largest, *chosen)))
        return People(self.frames, grid, persons, len(rest) - len(chosen))

    def _person(self, one: Trajectory) -> Person:
        colours = one.sum_colours() if one.colours else None
        return Person(find_present_frames(one), one.voxels, colours)

    def _look(self, indices: range) -> Iterator[tuple[Frame, np.ndarray]]:
        """Yield the frames in small pictures and their evidence, which is overwritten."""
        selection = select_span(indices, indices.step)
        frames = self._shrink.frames(self.session.sequence.frames(selection))
        return compute_ahead(frames, self._begin)

    def _observe(self, everything: list[Trajectory]) -> None:
        """Look at the colours of all trajectories in some frames, if there are pictures."""
        every = max(1, round(self.rate / _RATE))
        frames = self._look(self.frames[::every]) if self.session.has_images else ()
        for frame, evidence in frames:
            assert frame.images is not None
            ones = [one for one in everything if frame.index in one.voxels]
            parts = [one.voxels[frame.index] for one in ones]
            colours = self.space.measure_colours(frame.images, evidence, parts)
            for one, found in zip(ones, colours, strict=True):
                one.colours[frame.index] = found
