"""Follow people through the coarse voxels, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy

from psfs.common.numbers import find_true_runs
from psfs.people.coarse_voxels import DEBRIS, CoarseFrame, count_least_voxels
from psfs.voxels.division import BANDS, LEVELS
from psfs.voxels.grid import VoxelGrid

#: Greatest speed of a person, m/s.
SPEED = 4.0
#: Least height of a region with which somebody begins to be followed; that which a person reaches
#: at times, unlike an object; and that of a person's lowest part over the floor, m.
_LEAST_HEIGHT, TALL, LOWEST = 0.9, 1.2, 0.4
#: Least distance on the floor of two people, m.
APART = 0.45
#: Distance from a trajectory's voxels up to which a region without an owner belongs to it, and
#: beyond what the speed allows at which a person may return, m.
REACH = 0.4
#: Volume that a region must lose, as a share of one person's in it, for somebody to have gone: of
#: capsules 0.9 to 1.7 if so, else up to 0.5.
_CHANGE = 0.7
#: Weight of the last step in the running mean of a velocity.
_NEWEST = 0.5
#: Least volume, as share of the usual one, that shows that a person is there.
PRESENT = 0.35
#: Shares of a region's height above which heads may rise apart from each other: people differ in
#: height. Columns of voxels that a head has at least.
_NECKS, _LEAST_HEAD = (0.8, 0.85, 0.9), 4


@dataclass(eq=False)
class Trajectory:
    """Trajectory of a person or an object.

    voxels: flat indices, by frame. colours: histograms (BANDS, LEVELS^3), by frame, in some frames.
    points: the voxels' centres (N, 3) m in the frame that was followed last; speed: the velocity
    (2,) on the floor there, m per frame.
    """

    voxels: dict[int, np.ndarray] = field(default_factory=dict)
    colours: dict[int, np.ndarray] = field(default_factory=dict)
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    speed: np.ndarray = field(default_factory=lambda: np.zeros(2))

    @property
    def frames(self) -> np.ndarray:
        """Numbers (F,) of its frames, ascending."""
        return np.array(sorted(self.voxels))

    def sum_colours(self) -> np.ndarray:
        """Return the sum of the colours in all frames."""
        return sum(self.colours.values(), np.zeros((BANDS, LEVELS**3)))

    def advance(self, points: np.ndarray, reach: float) -> None:
        """Go on to the `points` (N, 3) m of the next frame."""
        step = np.clip(find_middle(points) - find_middle(self.points), -reach, reach)
        self.points, self.speed = points, (1 - _NEWEST) * self.speed + _NEWEST * step


def stands(points: np.ndarray, size: float) -> bool:
    """Return whether voxels with centres (N, 3) m, of edge `size`, reach from near the floor as
    high as a person."""
    low, high = points[:, 2].min(), points[:, 2].max()
    return bool(high - low + size >= _LEAST_HEIGHT and low <= LOWEST)


class PeopleFollower:
    """Assignment of the regions of one frame after the other to trajectories.

    A trajectory takes the region that contains most of its voxels, moved by its velocity. A region
    taken by several trajectories is split among them, see `_split`; its loss of volume tells when
    somebody goes from it, or came, as `follow` goes both ways. Of the remaining regions, one near a
    trajectory that does not stand as a person does, such as a separate leg, is added to that
    trajectory; a large one begins a new trajectory.
    """

    def __init__(self, grid: VoxelGrid, fps: float) -> None:
        self.grid = grid
        self._reach = max(REACH, 1.5 * SPEED / fps)
        self.all: list[Trajectory] = []
        self._going: list[Trajectory] = []

    def begin(self, trajectories: list[Trajectory], frame: int) -> None:
        """Go on from `frame` of these trajectories."""
        self.all = list(trajectories)
        self._going = [one for one in trajectories if frame in one.voxels]
        for one in self._going:
            one.points, one.speed = self.grid.centres(one.voxels[frame]), np.zeros(2)

    def __call__(self, frame: CoarseFrame) -> None:
        """Assign the regions of the next frame."""
        points = self.grid.centres(frame.voxels)
        n_regions = int(frame.regions.max()) + 1 if len(frame.regions) else 0
        sizes = np.bincount(frame.regions, minlength=n_regions)
        moved = [one.points + np.append(one.speed, 0) for one in self._going]
        owners = self._find_owners(points, frame.regions, sizes, moved)
        rows: list[np.ndarray] = [np.zeros(0, int) for _ in moved]
        for region in sorted({region for region in owners if region >= 0}):
            own = np.flatnonzero(frame.regions == region)
            who = [k for k, of in enumerate(owners) if of == region]
            parts = _split(points[own], [moved[k] for k in who])
            for k, part in zip(who, parts, strict=True):
                rows[k] = own[part]
        new = self._assign_rest(points, frame, sizes, owners, rows)
        pairs = zip(self._going, rows, strict=True)
        continued = [(one, own) for one, own in pairs if len(own) >= DEBRIS]
        for one, own in continued:
            one.voxels[frame.index] = frame.voxels[own]
            one.advance(points[own], self._reach)
        begun = [Trajectory({frame.index: frame.voxels[own]}, points=points[own]) for own in new]
        self.all += begun
        self._going = [*(one for one, _ in continued), *begun]

    def _assign_rest(
        self,
        points: np.ndarray,
        frame: CoarseFrame,
        sizes: np.ndarray,
        owners: list[int],
        rows: list[np.ndarray],
    ) -> list[np.ndarray]:
        """Give each region without an owner to the nearest trajectory, by adding to its `rows`, or
        return the rows of those that begin; those that stand first. Ghosts do neither."""
        owned = [own for own in range(len(sizes)) if own not in owners and own not in frame.ghosts]
        free = [np.flatnonzero(frame.regions == region) for region in owned]
        standing = [
            len(own) >= count_least_voxels(self.grid) and stands(points[own], self.grid.voxel_size)
            for own in free
        ]
        parts = list(rows)
        for k in sorted(range(len(free)), key=lambda k: (standing[k], len(free[k])), reverse=True):
            own = free[k]
            apart = [
                scipy.spatial.cKDTree(points[own]).query(points[part])[0].min()
                if len(part)
                else np.inf
                for part in parts
            ]
            nearest = int(np.argmin(apart)) if apart else -1
            if standing[k] or (nearest < 0 or apart[nearest] > REACH):
                if len(own) >= count_least_voxels(self.grid):
                    parts.append(own)
            else:
                parts[nearest] = np.concatenate([parts[nearest], own])
        rows[:] = parts[: len(rows)]
        return parts[len(rows) :]

    def _find_owners(
        self, points: np.ndarray, regions: np.ndarray, sizes: np.ndarray, moved: list[np.ndarray]
    ) -> list[int]:
        """Return for each trajectory the region that it takes, -1 for none."""
        if not len(points):
            return [-1] * len(moved)
        tree = scipy.spatial.cKDTree(points)
        reach = 1.5 * self.grid.voxel_size
        votes = np.zeros((len(moved), len(sizes)), int)
        for were, own in zip(moved, votes, strict=True):
            distance, nearest = tree.query(were, distance_upper_bound=reach)
            own += np.bincount(regions[nearest[np.isfinite(distance)]], minlength=len(sizes))
        owners = np.where(votes.any(1), votes.argmax(1), -1).tolist()
        self._end_vanished(votes, sizes, moved, owners)
        return owners

    def _end_vanished(
        self, votes: np.ndarray, sizes: np.ndarray, moved: list[np.ndarray], owners: list[int]
    ) -> None:
        """Take a region that several share from the one whose voxels fall into it least, if it has
        lost about that one's volume."""
        for region in set(owners) - {-1}:
            who = [k for k, of in enumerate(owners) if of == region]
            others = [of for of in owners if of not in (-1, region)]
            hit = np.setdiff1d(np.flatnonzero(votes[who].any(0)), others)
            least = min(who, key=lambda k: votes[k].sum() / len(moved[k]))
            lack = sum(len(moved[k]) for k in who) - sizes[hit].sum()
            if len(who) > 1 and lack > _CHANGE * len(moved[least]):
                owners[least] = -1


def _split(points: np.ndarray, moved: list[np.ndarray]) -> list[np.ndarray]:
    """Return the rows of points (N, 3) that belong to each of those whose voxels (M, 3) were
    there before: to the one whose voxels are nearest."""
    if len(moved) == 1:
        return [np.arange(len(points))]
    nearest = np.argmin([scipy.spatial.cKDTree(were).query(points)[0] for were in moved], axis=0)
    return [np.flatnonzero(nearest == k) for k in range(len(moved))]


def find_middle(points: np.ndarray) -> np.ndarray:
    """Return where on the floor (2,) most of the points (N, 3) are."""
    return np.median(points[:, :2], axis=0)


def follow(
    frames: list[CoarseFrame],
    grid: VoxelGrid,
    fps: float,
    number: int | None = None,
) -> list[Trajectory]:
    """Follow everything from the frame with most standing regions on to both ends of the take.

    fps: of the frames. People who touch at the beginning are thus distinguished by where they
    go later. number: how many people there are, if that is known. Where no frame shows so many
    apart, the widest regions are split in the frame in which their parts are most apart.
    """
    if not frames:
        return []
    counts = [_count_standing(frame, grid) for frame in frames]
    middle = _find_longest_maximum(counts)
    if number is not None and 0 < counts[middle][0] < number:
        most = max(counts)
        split = {
            k: _split_widest(frame, grid, number - most[0])
            for k, (frame, count) in enumerate(zip(frames, counts, strict=True))
            if count == most
        }
        middle = max(split, key=lambda k: split[k][1])
        frames = [*frames[:middle], split[middle][0], *frames[middle + 1 :]]
    forward, back = PeopleFollower(grid, fps), PeopleFollower(grid, fps)
    for frame in frames[middle:]:
        forward(frame)
    back.begin(forward.all, frames[middle].index)
    for frame in reversed(frames[:middle]):
        back(frame)
    return back.all


def _split_widest(frame: CoarseFrame, grid: VoxelGrid, n_more: int) -> tuple[CoarseFrame, float]:
    """Split the widest standing region in two, `n_more` times; return the frame, and how far apart
    the two parts are at the least, as a multiple of their own width."""
    points, regions, apart = grid.centres(frame.voxels), frame.regions.copy(), np.inf
    for _ in range(n_more):
        widest: tuple[float, np.ndarray] = 0.0, np.zeros(0, int)
        for region in range(int(regions.max()) + 1):
            own = np.flatnonzero(regions == region)
            large = len(own) >= count_least_voxels(grid)
            if large and region not in frame.ghosts and stands(points[own], grid.voxel_size):
                ratio, second = _halve(points[own, :2])
                widest = max(widest, (ratio, own[second]), key=lambda found: found[0])
        regions[widest[1]] = regions.max() + 1
        apart = min(apart, widest[0])
    return CoarseFrame(frame.index, frame.voxels, regions), apart


def _halve(floor: np.ndarray) -> tuple[float, np.ndarray]:
    """Divide points (N, 2) by the nearer of two means (Lloyd's method, from both sides of the
    longest axis); return the distance of the means as a multiple of the points' distance from
    them, and the rows of the second half."""
    spread = floor - floor.mean(0)
    axis = np.linalg.svd(spread, full_matrices=False)[2][0]
    second = spread @ axis > 0
    for _ in range(10):
        if second.all() or not second.any():
            return 0.0, np.zeros(0, int)
        means = floor[~second].mean(0), floor[second].mean(0)
        away = np.stack([np.linalg.norm(floor - mean, axis=1) for mean in means])
        second = away[1] < away[0]
    ratio = float(np.linalg.norm(means[1] - means[0]) / max(float(away.min(0).mean()), 1e-6))
    return ratio, np.flatnonzero(second)


def _count_standing(frame: CoarseFrame, grid: VoxelGrid) -> tuple[int, int]:
    """Return the number of large regions that stand, and 1 if there is any large one, else 0."""
    regions = _large_regions(frame, grid)
    return sum(stands(points, grid.voxel_size) for points in regions), min(1, len(regions))


def count_heads(frames: list[CoarseFrame], grid: VoxelGrid) -> int | None:
    """Return how many people there are by their heads in most frames, None unless they are more
    than stand apart in any frame."""
    number = count_at_once(frames, grid)
    apart = max((_count_standing(frame, grid)[0] for frame in frames), default=0)
    return number if number > apart > 0 else None


def count_at_once(frames: list[CoarseFrame], grid: VoxelGrid) -> int:
    """Return how many people most frames show at once, each with a head and enough of a body."""
    heads = [_count_heads(frame, grid) for frame in frames]
    return int(np.median(heads)) if heads else 0


def _count_heads(frame: CoarseFrame, grid: VoxelGrid) -> int:
    """Return how many heads the large regions that stand have, each above enough of a body: volumes
    grow with the cube of the height."""
    number = 0
    for points in _large_regions(frame, grid):
        if not stands(points, grid.voxel_size):
            continue
        heads = max((_find_rising(points, share, grid.voxel_size) for share in _NECKS), key=len)
        if len(heads) > 1:
            apart = [np.linalg.norm(points[:, :2] - head, axis=1) for head in heads]
            below = np.argmin(apart, axis=0)
            volumes = np.bincount(below, minlength=len(heads))
            tops = [points[below == k, 2].max() for k in range(len(heads))]
            girths = volumes / np.array(tops) ** 3
            number += int((girths >= PRESENT * girths.max()).sum())
        else:
            number += 1
    return number


def _find_rising(points: np.ndarray, share: float, size: float) -> list[np.ndarray]:
    """Return the middles (2,) of the parts of a region, of some columns of voxels each, that rise
    apart from each other above this share of its height, as high and as far apart as people."""
    above = points[points[:, 2] > max(share * points[:, 2].max(), TALL)]
    if not len(above):
        return []
    columns = np.round((above[:, :2] - above[:, :2].min(0)) / size).astype(int)
    floor = np.zeros(columns.max(0) + 1, bool)
    floor[tuple(columns.T)] = True
    labels, n_parts = scipy.ndimage.label(floor, np.ones((3, 3)))
    found: list[np.ndarray] = []
    for part in range(1, n_parts + 1):
        middle = find_middle(above[labels[tuple(columns.T)] == part])
        near = [of for of in found if np.linalg.norm(of - middle) < APART]
        if np.sum(labels == part) >= _LEAST_HEAD and not near:
            found.append(middle)
    return found


def _large_regions(frame: CoarseFrame, grid: VoxelGrid) -> list[np.ndarray]:
    """Return the centres (N, 3) m of the voxels of each large region that is no ghost."""
    sizes = np.bincount(frame.regions) if len(frame.regions) else np.zeros(0, int)
    large = np.flatnonzero(sizes >= count_least_voxels(grid))
    points = grid.centres(frame.voxels)
    return [points[frame.regions == r] for r in large if r not in frame.ghosts]


def _find_longest_maximum(counts: list[tuple[int, int]]) -> int:
    """Return the middle of the longest run of the greatest count."""
    runs = find_true_runs(np.array([count == max(counts) for count in counts]))
    longest = max(runs, key=lambda run: run.stop - run.start)
    return (longest.start + longest.stop) // 2
