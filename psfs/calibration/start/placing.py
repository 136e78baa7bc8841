"""Place the cameras from pairs that see the target together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import scipy

from cl import InputError
from psfs.calibration.targets.target import Sighting, group_by_frame

Pair = tuple[int, int]
#: Frames with the target below which a camera sees too little; and fewest that two cameras share so
#: that one can be placed by the other: with a wand, of which a picture tells little, and with a
#: board, whose pose each picture tells.
FEW_FRAMES, FEW_WANDS, FEW_BOARDS = 12, 10, 3


def count_shared_frames(sightings: Sequence[Sighting], views: int) -> np.ndarray:
    """Count the frames in which two cameras see the target together (V, V); diagonal: one camera
    alone."""
    counts = np.zeros((views, views), int)
    for frame_sightings in group_by_frame(sightings).values():
        here = [sighting.view for sighting in frame_sightings]
        counts[np.ix_(here, here)] += 1
    return counts


def check_linked(counts: np.ndarray, fewest: int, names: Sequence[str], what: str) -> None:
    """Raise InputError unless pairs that share `fewest` frames with the target link all cameras."""
    shared = counts - np.diag(np.diag(counts))
    groups, group = scipy.sparse.csgraph.connected_components(
        scipy.sparse.csr_matrix(shared >= fewest), directed=False
    )
    if groups == 1:
        return
    members = [[names[int(v)] for v in np.flatnonzero(group == g)] for g in range(groups)]
    members.sort(key=len, reverse=True)
    parts = " | ".join(" ".join(group_names) for group_names in members)
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


def find_spanning_pairs(counts: np.ndarray, fewest: int) -> list[Pair]:
    """Return pairs of cameras (known, new) that form a tree over all cameras with most shared
    frames.

    The first pair begins at the camera that shares most.
    """
    shared = np.where(counts >= fewest, counts, 0)
    np.fill_diagonal(shared, 0)
    weights = np.divide(1.0, shared, out=np.zeros(shared.shape), where=shared > 0)
    tree = scipy.sparse.csgraph.minimum_spanning_tree(scipy.sparse.csr_matrix(weights))
    root = int(shared.sum(axis=1).argmax())
    order, before = scipy.sparse.csgraph.breadth_first_order(tree, root, directed=False)
    return [(int(before[view]), int(view)) for view in order[1:]]


def chain_poses(
    pairs: Sequence[Pair], relative: Mapping[Pair, np.ndarray]
) -> dict[int, np.ndarray]:
    """Return the poses (4, 4) of all cameras in the frame of the first one.

    relative: transform from the known camera of a pair to the new one.
    """
    poses = {pairs[0][0]: np.eye(4)}
    for known, new in pairs:
        poses[new] = relative[known, new] @ poses[known]
    return poses
