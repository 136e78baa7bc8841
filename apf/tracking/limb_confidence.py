"""Confidence of each limb of a track, estimated without ground truth.

A wrong arm usually lies inside the silhouettes, along the body or in the trunk, and fits them about
as well as a correct arm. Three signs show it, all known without further work on the device:

- the margin: the relative rise of the error if the limb's end moves to the best other place that
  the limb search found, which tries every limb elsewhere in every frame,
- the jitter: the acceleration of the limb's end divided by its speed,
- the disagreement, if a take was tracked in several passes, forward and backward: where they put
  the end of a limb at different places, some of them are wrong. That it is not the chosen one is
  for the other signs to say.

They are averaged over time and enter a logistic regression. That of one pass was fitted to limbs
with errors above 200 mm and below 150 mm, equally many of each; that of several passes to 60,000
limbs of 150 tracks of generated takes, both such that 3.5 % of the correct limbs count as lost; of
the wrong ones 84 % do.
"""

from __future__ import annotations

import numpy as np
import scipy

from apf.body.kinematics import posed_joints
from apf.body.limbs import limb_ends
from apf.body.model import BodyModel
from psfs.common.numbers import STEP_SECONDS

#: Confidence below which a limb counts as lost: even odds.
LOST = 0.5
#: Distance, m, up to which two positions of a joint or limb's end are the same place.
SAME_PLACE = 0.15
#: A limb counts as lost if its end is farther than this, m, from the truth for long, see
#: `apf.evaluation.evaluate`.
LOST_LIMB = 0.200
#: Least distance, m, between passes; smaller ones carry no more information.
LEAST_DISTANCE = 0.02
#: Log-odds after one pass, and after several: constant, coefficients of the root of the margin, of
#: the jitter, s, and of the logarithm of the distance, m, between passes.
_ONE_PASS, _SEVERAL = (-12.9, 36.1, -0.033, 0.0), (-8.03, 5.57, -0.111, -2.9)
#: Largest margin that carries information; m/s added to the speed, so that an end at rest has
#: little jitter; time, s, over which all inputs are averaged, distances by their logarithms.
_MOST_MARGIN, _REST_SPEED, _WINDOW = 0.3, 0.5, 0.4


def lasts_long_enough(times: np.ndarray) -> bool:
    """Return whether frames at `times` (F,) s last long enough for limbs to be judged: the passes
    over fewer all begin at nearly the same pose, and agree on it even if it is wrong."""
    if len(times) < 2:
        return False
    step = float(np.median(np.diff(times)))
    return bool(times[-1] - times[0] + step >= STEP_SECONDS - 1e-9)


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
    errors_now = np.take_along_axis(errors, chosen[:, None], 1)
    tried = posed_joints(body, candidates.reshape(-1, body.n_dof))[:, ends]
    tried = tried.reshape(n_frames, n_candidates, len(ends), 3)
    moved = np.linalg.norm(tried - posed_joints(body, poses)[:, None, ends], axis=-1)
    excess = (errors - errors_now) / np.maximum(np.abs(errors_now), 1e-6)
    margins: np.ndarray = np.where(moved > SAME_PLACE, excess[..., None], np.inf).min(1)
    return np.maximum(margins, 0.0)


def limb_confidence(
    margins: np.ndarray,
    ends: np.ndarray,
    times: np.ndarray,
    disagreement: np.ndarray | None = None,
) -> np.ndarray:
    """Return the probability (F, L) that each limb is right; NaN where nothing is known, and
    everywhere if the frames do not last long enough.

    margins: (F, L), see `limb_margins`. ends: (F, L, 3) m, the limbs' ends at `times` (F,) s.
    disagreement: (F, L) m, geometric mean of the distances between the ends in the track and in the
    passes. Where it is known, an unknown margin says nothing: it is that of even odds after one
    pass.
    """
    if not lasts_long_enough(times):
        return np.full(margins.shape, np.nan)
    n = max(1, round(_WINDOW / float(np.median(np.diff(times)))))
    capped = np.sqrt(np.clip(margins, 0.0, _MOST_MARGIN))
    margin = _average_over_time(capped, n)
    jitter = _average_over_time(_measure_jitter(ends, times), n)
    odds = _log_odds(_ONE_PASS, margin, jitter, np.zeros_like(margin))
    if disagreement is not None:
        far = _average_over_time(np.log(np.maximum(disagreement, LEAST_DISTANCE)), n)
        margin = np.where(np.isfinite(margin), margin, -_ONE_PASS[0] / _ONE_PASS[1])
        odds = np.where(np.isfinite(far), _log_odds(_SEVERAL, margin, jitter, far), odds)
    return scipy.special.expit(odds)


def _log_odds(
    coefficients: tuple[float, ...], margin: np.ndarray, jitter: np.ndarray, distance: np.ndarray
) -> np.ndarray:
    constant, *slopes = coefficients
    odds = np.tensordot(slopes, np.stack([margin, jitter, distance]), 1)
    return np.asarray(constant + odds)


def _measure_jitter(ends: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return acceleration over speed (F, L), 1/s; the first and the last frame repeat their
    neighbours."""
    if len(times) < 3:
        return np.zeros(ends.shape[:2])
    steps = np.diff(times)[:, None, None]
    velocities = np.diff(ends, axis=0) / np.maximum(steps, 1e-6)
    turns = np.diff(velocities, axis=0) / (0.5 * np.maximum(steps[1:] + steps[:-1], 1e-6))
    speeds = np.linalg.norm(velocities[:-1], axis=-1)
    jitter = np.linalg.norm(turns, axis=-1) / (speeds + _REST_SPEED)
    return np.concatenate([jitter[:1], jitter, jitter[-1:]])


def _average_over_time(values: np.ndarray, n: int) -> np.ndarray:
    """Return the moving averages of values (F, L) over n frames (n + 1 if n is even)."""
    return scipy.ndimage.uniform_filter1d(values, n + 1 - n % 2, axis=0, mode="nearest")
