"""The curves of the page, as plain values: angles, confidence, agreement."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np

from apf.body.model import find_side, plain_name, sideless
from apf.report.quality import Quality
from apf.tracking.track import Track
from psfs.common.numbers import json_number


def angle_curves(track: Track) -> list[dict[str, Any]]:
    """Return the joints' angles, degrees, NaN where lost, in groups of curves (name, side, values
    (F,)).

    They are clinical angles, see `apf.body.angles`, or the body's own if it has none.
    """
    groups = defaultdict[str, list[dict[str, Any]]](list)
    for name, values in track.angles.items():
        side, (joint, *of) = find_side(name), sideless(name).split("_")
        curve = {"name": " ".join(of), "side": side, "values": round_for_json(values, 1)}
        groups[joint].append(curve)
    if not groups:
        for bone in track.its_body.bones:
            for axis in bone.axes:
                if axis.kind[0] == "r":
                    turned = np.degrees(np.unwrap(track.poses[:, axis.dof]))
                    values = np.where(track.lost, np.nan, turned)
                    curve = {"name": f"about {axis.kind[1]}", "side": "middle"}
                    groups[plain_name(bone.name)].append(
                        {**curve, "values": round_for_json(values, 1)}
                    )
    return [{"name": name, "curves": curves} for name, curves in groups.items()]


def confidence_curves(quality: Quality) -> dict[str, object]:
    """Return the track's confidence per frame, and each part's in the judged frames."""
    return {
        "frames": round_for_json(quality.track.confidence, 3),
        "parts": list(quality.parts),
        "values": [round_for_json(values, 3) for values in quality.confidence.T],
    }


def agreement_curves(quality: Quality) -> dict[str, object] | None:
    """Return the IoU of body and voxels per camera in the judged frames."""
    found = quality.agreement
    if found is None:
        return None
    return {
        "cameras": list(found.cameras),
        "body": [round_for_json(values, 3) for values in found.body_iou.T],
        "voxels": [round_for_json(values, 3) for values in found.voxel_iou.T],
    }


def round_for_json(values: np.ndarray, digits: int) -> list[float | None]:
    """Round values (n,) for JSON: None for NaN."""
    return [json_number(value, digits) for value in values]
