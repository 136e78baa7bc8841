"""The curves of a page, as plain values: angles, confidence, agreement."""

from __future__ import annotations

from typing import Any

import numpy as np

from apf.report.parts import plain_name
from apf.report.quality import Quality
from apf.tracking.track import Track


def angle_curves(track: Track) -> list[dict[str, Any]]:
    """Return the body's joint angles, degrees, in groups by bone: name, curves with a name and
    values (F,), turns taken out."""
    body, groups = track.its_body, {}
    for bone in body.bones:
        axes = [axis for axis in bone.axes if axis.kind[0] == "r"]
        if axes:
            groups[plain_name(bone.name)] = [
                {
                    "name": f"about {axis.kind[1]}",
                    "values": rounded(np.degrees(np.unwrap(track.poses[:, axis.dof])), 1),
                }
                for axis in axes
            ]
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
