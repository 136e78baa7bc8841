"""Match joint names of other programs to the joints that `apf evaluate` compares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from apf.keypoints.landmarks import list_sided_names, normalise_name

#: The joints that `apf evaluate` compares.
EVALUATED_JOINTS = (
    "pelvis", "neck", "head_top",
    "l_shoulder", "l_elbow", "l_wrist", "r_shoulder", "r_elbow", "r_wrist",
    "l_hip", "l_knee", "l_ankle", "r_hip", "r_knee", "r_ankle",
)  # fmt: skip
#: Points that it compares beside them, which no mean contains: the tips of the toes.
TOES = ("l_toe", "r_toe")

#: Names per joint, best first, in lower case and without separators. Pose2Sim, OpenPose and
#: MediaPipe use plain English names; BVH files name the bone that starts at the joint.
_MIDDLE = {
    "pelvis": ("pelvis", "midhip", "hipcenter", "hipcentre", "hips", "root"),
    "neck": ("neck", "neckbase", "c7"),
    # Pose2Sim's Head is the top of the head; beside a head_top, head means another point.
    "head_top": ("headtop", "topofhead", "headend", "vertex", "head"),
}
_SIDED = {
    "shoulder": ("shoulder", "uparm", "upperarm", "arm"),
    "elbow": ("elbow", "forearm", "lowerarm", "lowarm"),
    "wrist": ("wrist", "hand"),
    "hip": ("hip", "upleg", "upperleg", "thigh"),
    "knee": ("knee", "leg", "lowerleg", "lowleg", "calf", "shin"),
    "ankle": ("ankle", "foot"),
    "toe": ("toetip", "bigtoe", "toe"),
}


ALIASES: dict[str, tuple[str, ...]] = _MIDDLE | {
    f"{side}_{joint}": list_sided_names(words, side)
    for side in "lr"
    for joint, words in _SIDED.items()
}


def match_joints(names: Sequence[str], joints: Sequence[str] = EVALUATED_JOINTS) -> dict[str, int]:
    """Return the index in `names` of each of `joints` that is there under any of its names."""
    plain = [normalise_name(name.split(":")[-1]) for name in names]
    matches = {}
    for joint in joints:
        index = next((plain.index(alias) for alias in ALIASES[joint] if alias in plain), None)
        if index is not None:
            matches[joint] = index
    return matches


def evaluated_joints(
    names: Sequence[str], joints: np.ndarray
) -> tuple[np.ndarray, list[str], list[str]]:
    """Select EVALUATED_JOINTS (F, 15, 3) from joints (F, J, 3) named `names`; NaN if absent.

    Also return which of the 15 were found (a missing pelvis is the middle of the hips) and which of
    `names` match none.
    """
    matches = match_joints(names)
    out = np.full((len(joints), len(EVALUATED_JOINTS), 3), np.nan)
    for joint, index in matches.items():
        out[:, EVALUATED_JOINTS.index(joint)] = joints[:, index]
    used = {*matches.values(), *match_joints(names, TOES).values()}
    unused = [name for index, name in enumerate(names) if index not in used]
    present = set(matches)
    if "pelvis" not in matches and {"l_hip", "r_hip"} <= present:
        hips = joints[:, [matches["l_hip"], matches["r_hip"]]]
        out[:, EVALUATED_JOINTS.index("pelvis")] = hips.mean(axis=1)
        present.add("pelvis")
    return out, [joint for joint in EVALUATED_JOINTS if joint in present], unused
