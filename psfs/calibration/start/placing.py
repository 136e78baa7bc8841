"""Places of the cameras from the target that pairs of them see together, as a start."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from cl import InputError
from psfs.calibration.targets.target import Sighting, by_frame

Pair = tuple[int, int]


def shared_frames(sightings: Sequence[Sighting], views: int) -> np.ndarray:
    """Return in how many frames two cameras see the target together (V, V); alone on the
    diagonal."""
    counts = np.zeros((views, views), int)
    for found in by_frame(sightings).values():
        here = [sighting.view for sighting in found]
        counts[np.ix_(here, here)] += 1
    return counts


def check_linked(counts: np.ndarray, fewest: int, names: Sequence[str], what: str) -> None:
    """Raise InputError unless all cameras are linked by pairs that share `fewest` frames with the
    target, `what`."""
    shared = counts - np.diag(np.diag(counts))
    groups, group = connected_components(csr_matrix(shared >= fewest), directed=False)
    if groups == 1:
        return
    members = [[names[int(v)] for v in np.flatnonzero(group == g)] for g in range(groups)]
    members.sort(key=len, reverse=True)
    parts = " | ".join(" ".join(of) for of in members)
    between = max(
        int(shared[np.ix_(group == a, group == b)].max()) for a, b in combinations(range(groups), 2)
    )
    ask = f"expected {fewest} or more: hold the {what} where such cameras see it at once"
    if len(members[0]) == 1:
        raise InputError(
            f"too few common views: two cameras see the {what} together in {between} frames at "
            f"most; {ask}"
        )
    if len(members) == 2 and len(members[1]) == 1:
        raise InputError(
            f"too few common views: {members[1][0]} sees the {what} together with another camera "
            f"in {between} frames at most; {ask}"
        )
    raise InputError(
        f"the cameras are in {groups} groups ({parts}) that share {between} frames with the "
        f"{what} at most; {ask}"
    )


def spanning_pairs(counts: np.ndarray, fewest: int) -> list[Pair]:
    """Return pairs of cameras (known, new) that lead from one camera to all others: a tree with as
    many shared frames as can be. The first pair begins at the camera that shares most."""
    shared = np.where(counts >= fewest, counts, 0)
    np.fill_diagonal(shared, 0)
    weights = np.divide(1.0, shared, out=np.zeros(shared.shape), where=shared > 0)
    tree = minimum_spanning_tree(csr_matrix(weights))
    root = int(shared.sum(axis=1).argmax())
    order, before = breadth_first_order(tree, root, directed=False)
    return [(int(before[view]), int(view)) for view in order[1:]]


def chained(pairs: Sequence[Pair], relative: Mapping[Pair, np.ndarray]) -> dict[int, np.ndarray]:
    """Return the poses (4, 4) of all cameras, the world being that of the first one's. relative:
    the motion from the known camera of a pair to the new one."""
    poses = {pairs[0][0]: np.eye(4)}
    for known, new in pairs:
        poses[new] = relative[known, new] @ poses[known]
    return poses
