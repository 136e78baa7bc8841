"""The curves of a page, as plain values: angles, confidence, agreement."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np

from apf.body.model import side_of, sideless
from apf.report.parts import plain_name
from apf.report.quality import Quality
from apf.tracking.track import Track


def angle_curves(track: Track) -> list[dict[str, Any]]:
    """Return the joints' angles, degrees, NaN where lost, in groups: name, curves with a name, a
    side and values (F,). Clinical ones, see `apf.body.angles`; of a body that has none its own."""
    groups = defaultdict[str, list[dict[str, Any]]](list)
    for name, values in track.angles.items():
        side, (joint, *of) = side_of(name), sideless(name).split("_")
        curve = {"name": " ".join(of), "side": side, "values": rounded(values, 1)}
        groups[joint].append(curve)
    if not groups:
        for bone in track.its_body.bones:
            for axis in bone.axes:
                if axis.kind[0] == "r":
                    turned = np.degrees(np.unwrap(track.poses[:, axis.dof]))
                    values = np.where(track.lost, np.nan, turned)
                    curve = {"name": f"about {axis.kind[1]}", "side": "middle"}
                    groups[plain_name(bone.name)].append({**curve, "values": rounded(values, 1)})
    return [{"name": name, "curves": curves} for name, curves in groups.items()]


def confidence_curves(quality: Quality) -> dict[str, Any]:
    """Return the tracker's confidence in every frame and that in every part in those judged."""
    return {
        "frames": rounded(quality.track.confidence, 3),
        "parts": list(quality.parts),
        "values": [rounded(values, 3) for values in quality.confidence.T],
    }


def agreement_curves(quality: Quality) -> dict[str, Any] | None:
    """Return the IoU per camera of body and voxels in the frames judged."""
    found = quality.agreement
    if found is None:
        return None
    return {
        "cameras": list(found.cameras),
        "body": [rounded(values, 3) for values in found.body_iou.T],
        "voxels": [rounded(values, 3) for values in found.voxel_iou.T],
    }


def rounded(values: np.ndarray, digits: int) -> list[float | None]:
    """Return values (n,) as JSON has them: None for NaN."""
    return [None if np.isnan(v) else round(float(v), digits) for v in np.asarray(values, float)]
