"""Runs in aniposelib's environment: `run_aniposelib.py IN.npz CALIBRATION.toml OUT.npz KIND`.

IN: points (C, F, J, 2) px, NaN where missing, scores (C, F, J), limbs (K, 2) joints a constant
length apart. KIND: linear, `CameraGroup.triangulate`, or optimised, `triangulate_optim` with limbs.
OUT: points (F, J, 3). Prints seconds as JSON; the first call, which compiles, is not counted.
"""

import json
import sys
import time

import numpy as np
from aniposelib.cameras import CameraGroup

given = np.load(sys.argv[1])
group = CameraGroup.load(sys.argv[2])
points, scores, limbs = given["points"].astype(float), given["scores"], given["limbs"].tolist()
n_cameras, n_frames, n_joints, _ = points.shape


def triangulate(points):
    """Return (F, J, 3) of points (C, F, J, 2)."""
    if sys.argv[4] == "optimised":
        # anipose's own settings of [triangulation] with optim = true; the others are the library's
        return group.triangulate_optim(
            points, constraints=limbs, scores=scores[:, : points.shape[1]], init_progress=False
        )
    flat = group.triangulate(points.reshape(n_cameras, -1, 2), progress=False)
    return flat.reshape(points.shape[1], n_joints, 3)


triangulate(points[:, :12])
cpu, clock = time.process_time(), time.perf_counter()
found = triangulate(points)
seconds = {"cpu": time.process_time() - cpu, "clock": time.perf_counter() - clock}
np.savez(sys.argv[3], points=found)
print(json.dumps(seconds))
