"""A body as spheres along its cones: about where it is, for what need not know its shape."""

from __future__ import annotations

import numpy as np

from apf.body.kinematics import posed_cones
from apf.body.model import BodyModel

#: Spheres along a cone.
ALONG = 4


def count_spheres(body: BodyModel) -> int:
    """Return the number of a body's spheres."""
    return len(body.cones) * ALONG


def body_spheres(body: BodyModel, pose: np.ndarray) -> np.ndarray:
    """Return spheres (C * ALONG, 4), centres and radii, m, along the cones of `body` in `pose`
    (D,)."""
    cones = posed_cones(body, pose[None])[0]
    share = np.linspace(0, 1, ALONG)[:, None]
    start, end = cones[:, None, 0:4], cones[:, None, 4:8]
    return np.asarray((start + share * (end - start)).reshape(-1, 4))
