"""Confidence of each limb of a track, estimated without ground truth.

A wrong arm usually lies inside the silhouettes, along the body or in the trunk, and fits them about
as well as a correct arm. If a take was tracked in several passes, forward and backward, their
disagreement shows it: where they put the end of a limb at different places, some of them are
wrong. If a take was tracked in one direction only, as in live tracking, there are two signs: the
limb fits nearly as well elsewhere, and its end trembles. The limb search tries every limb elsewhere
in every frame, so both are known without further work on the device:

- the margin: the relative rise of the error if the limb's end moves to the best other place that
  the search found,
- the jitter: the acceleration of the limb's end divided by its speed.

Both are averaged over time and enter a logistic regression. It was fitted to limbs with errors
above 200 mm and below 150 mm, equally many of each, such that 3 to 4 % of the correct limbs count
as lost; of the wrong ones 85 % do after one pass, nine of ten if passes are compared.
"""

from __future__ import annotations

import numpy as np
import scipy

from apf.body.kinematics import posed_joints
from apf.body.limbs import limb_ends
from apf.body.model import BodyModel

#: Confidence below which a limb counts as lost: even odds.
LOST = 0.5
#: Distance, m, up to which two positions of a joint or limb's end are the same place.
SAME_PLACE = 0.15
#: A limb counts as lost if its end is farther than this, m, from the truth for long, see
#: `apf.evaluation.evaluate`.
LOST_LIMB = 0.200
#: Time, s, that a track must last for its limbs to be judged: the passes over a shorter one all
#: begin at nearly the same pose, and agree on it even if it is wrong.
LEAST_SECONDS = 0.5
#: Least distance, m, between passes; smaller ones carry no more information.
LEAST_DISTANCE = 0.02
#: Log-odds after one pass: constant, coefficients of the root of the margin and of the jitter, s.
_CONSTANT, _MARGIN, _JITTER = -12.9, 36.1, -0.033
#: Coefficient of the logarithm of the distance between passes, and the distance, m, of even odds.
_DISAGREEMENT, _EVEN_DISTANCE = -10.9, 0.045
#: Largest margin that carries information; m/s added to the speed, so that an end at rest has
#: little jitter; time, s, over which all inputs are averaged, distances by their logarithms.
_MOST_MARGIN, _REST_SPEED, _WINDOW = 0.3, 0.5, 0.4


def lasts_long_enough(times: np.ndarray) -> bool:
    """Return whether frames at `times` (F,) s last for `LEAST_SECONDS`."""
    if len(times) < 2:
        return False
    step = float(np.median(np.diff(times)))
    return bool(times[-1] - times[0] + step >= LEAST_SECONDS - 1e-9)


def limb_margins(
    body: BodyModel, poses: np.ndarray, candidates: np.ndarray, errors: np.ndarray
) -> np.ndarray:
    """Return the margin (F, L) of each limb of the estimates `poses` (F, D).

    The margin is the relative excess of the error of the best candidate, out of `candidates` (F, K,
    D) with `errors` (F, K), that puts the limb's end elsewhere, beyond `SAME_PLACE`. It is inf
    if no candidate does, and NaN without a limb search (K < 2). The error of the estimate is that
    of the candidate nearest to it.
    """
    ends, (n_frames, n_candidates) = limb_ends(body), errors.shape
    if n_candidates < 2:
        return np.full((n_frames, len(ends)), np.nan)
    chosen = np.abs(candidates - poses[:, None]).max(-1).argmin(1)
    own = np.take_along_axis(errors, chosen[:, None], 1)
    tried = posed_joints(body, candidates.reshape(-1, body.n_dof))[:, ends]
    tried = tried.reshape(n_frames, n_candidates, len(ends), 3)
    moved = np.linalg.norm(tried - posed_joints(body, poses)[:, None, ends], axis=-1)
    excess = (errors - own) / np.maximum(np.abs(own), 1e-6)
    margins: np.ndarray = np.where(moved > SAME_PLACE, excess[..., None], np.inf).min(1)
    return np.maximum(margins, 0.0)


def limb_confidence(
    margins: np.ndarray,
    ends: np.ndarray,
    times: np.ndarray,
    disagreement: np.ndarray | None = None,
) -> np.ndarray:
    """Return the probability (F, L) that each limb is right; NaN where nothing is known, and
    everywhere if the frames last for less than `LEAST_SECONDS`.

    margins: (F, L), see `limb_margins`. ends: (F, L, 3) m, the limbs' ends at `times` (F,) s.
    disagreement: (F, L) m, geometric mean of the distances between the ends in the track and in the
    passes; where it is known, it alone decides.
    """
    if not lasts_long_enough(times):
        return np.full(margins.shape, np.nan)
    n = max(1, round(_WINDOW / float(np.median(np.diff(times)))))
    capped = np.sqrt(np.clip(margins, 0.0, _MOST_MARGIN))
    odds = _CONSTANT + _MARGIN * _average_over_time(capped, n)
    odds = odds + _JITTER * _average_over_time(_measure_jitter(ends, times), n)
    if disagreement is not None:
        far = np.log(np.maximum(disagreement, LEAST_DISTANCE) / _EVEN_DISTANCE)
        known = _average_over_time(far, n)
        odds = np.where(np.isfinite(known), _DISAGREEMENT * known, odds)
    return scipy.special.expit(odds)


def _measure_jitter(ends: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return acceleration over speed (F, L), 1/s; the first and the last frame repeat their
    neighbours."""
    if len(times) < 3:
        return np.zeros(ends.shape[:2])
    steps = np.diff(times)[:, None, None]
    velocities = np.diff(ends, axis=0) / np.maximum(steps, 1e-6)
    turns = np.diff(velocities, axis=0) / (0.5 * np.maximum(steps[1:] + steps[:-1], 1e-6))
    speeds = np.linalg.norm(velocities[:-1], axis=-1)
    found = np.linalg.norm(turns, axis=-1) / (speeds + _REST_SPEED)
    return np.concatenate([found[:1], found, found[-1:]])


def _average_over_time(values: np.ndarray, n: int) -> np.ndarray:
    """Return the moving averages of values (F, L) over n frames (n + 1 if n is even)."""
    return scipy.ndimage.uniform_filter1d(values, n + 1 - n % 2, axis=0, mode="nearest")
