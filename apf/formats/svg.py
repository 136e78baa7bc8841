"""A moving stick figure as SVG, which notebooks show without a script."""

from __future__ import annotations

import numpy as np

#: Height of the picture, px; most frames of it.
_HEIGHT, _MOST_FRAMES = 240, 60


def animate_skeleton(joints: np.ndarray, edges: np.ndarray, fps: float) -> str:
    """Return an SVG element that repeats a motion, seen from the side from which it is widest.

    joints: (F, J, 3) m, Z up; a frame with a joint that is NaN shows the one before. edges: (E, 2)
    int joint pairs. fps: frames per second.
    """
    joints = joints[np.isfinite(joints).all(axis=(1, 2))]
    if not len(joints):
        return ""
    seconds = len(joints) / fps
    joints = joints[:: -(-len(joints) // _MOST_FRAMES)]
    floor = joints[..., :2].reshape(-1, 2)
    across = np.linalg.svd(floor - floor.mean(axis=0), full_matrices=False)[2][0]
    points = np.stack([joints[..., :2] @ across, -joints[..., 2]], axis=-1)
    low, high = points.min(axis=(0, 1)) - 0.1, points.max(axis=(0, 1)) + 0.1
    points = np.rint((points - low) * _HEIGHT / (high - low)[1]).astype(int)
    width = round(_HEIGHT * (high - low)[0] / (high - low)[1])
    lines = []
    for start, end in edges.tolist():
        moves = "".join(
            f'<animate attributeName="{name}" dur="{seconds:.3g}s" repeatCount="indefinite" '
            f'values="{";".join(map(str, points[:, joint, axis].tolist()))}"/>'
            for joint, number in ((start, 1), (end, 2))
            for axis, name in enumerate((f"x{number}", f"y{number}"))
        )
        lines.append(f"<line>{moves}</line>")
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{_HEIGHT}" '
        'stroke="#2e8b57" stroke-width="4" stroke-linecap="round">' + "".join(lines) + "</svg>"
    )
