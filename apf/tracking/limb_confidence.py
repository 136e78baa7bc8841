"""How far each limb of a track is to be believed, judged without truth.

A wrong arm mostly lies inside the silhouettes, laid along the body or into the trunk, and fits them
about as well as a right one. A take that was tracked both ways, by several runs, gives it away:
where they have a limb's end apart, some of them are wrong at least. Of what was tracked one way, as
live, it is that the limb fits nearly as well elsewhere, and that its end trembles. The limb search
tries every limb elsewhere in every frame, so that both are known without computing anything more on
the device:

- the margin: by what share the error rises when the limb's end is moved, to the best other place
  that the search found,
- the jitter: the acceleration of the limb's end over its speed.

Each is a mean over a moment, and they add up to log-odds by a logistic regression.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.special import expit

from apf.body.kinematics import posed_joints
from apf.body.limbs import limb_ends
from apf.body.model import BodyModel

#: m from the limb's end beyond which another candidate has it elsewhere.
ELSEWHERE = 0.15
#: A limb is lost where it is believed less than this.
LOST = 0.5


@dataclass(frozen=True)
class Regression:
    """The log-odds that a limb is right. Fitted by logistic regression on limbs beyond 200 mm and
    within 150 mm, as many of either, of tracks of box, jacks, kick and run in the shared suite;
    constants so that 4 % of the right ones count as lost, of several ways 3 %.

    One way, of seven runs, 86 % of the wrong ones do; 85 % on pickup, salsa and walks, with 4 % of
    the right ones. By two runs each both ways, of 25 tracks of box, jacks, run, pickup and salsa,
    all of which chose `apart`, 22 of 24 with 3 %. Margin and jitter add nothing to that, and count
    real limbs as lost that are right.
    """

    constant: float = -12.9
    """One way, log-odds of what has neither margin nor jitter."""
    margin: float = 36.1
    """Per root of the margin."""
    jitter: float = -0.033
    """Per 1/s of jitter."""
    most_margin: float = 0.3
    """Larger margins say no more."""
    at_rest: float = 0.5
    """m/s that is added to the speed, so that an end at rest does not tremble. By hand."""
    apart: float = 0.045
    """m from the track's end to the ways', at which a limb is as likely wrong as right."""
    disagreement: float = -10.9
    """Log-odds per factor e of the distance beyond it."""
    least: float = 0.02
    """m, a smaller distance says no more. By hand."""
    window: float = 0.4
    """s over which all are averaged, of distances the logarithms."""


REGRESSION = Regression()


def limb_margins(
    body: BodyModel, poses: np.ndarray, candidates: np.ndarray, errors: np.ndarray
) -> np.ndarray:
    """Return (F, L) by what share of the error of the estimates `poses` (F, D) the best of the
    `candidates` (F, K, D) with `errors` (F, K) is worse that has a limb's end elsewhere: inf where
    none has, NaN where no limb was looked for (K < 2). The estimate's error is that of the
    candidate that it is."""
    ends, (n_frames, n_candidates) = limb_ends(body), errors.shape
    if n_candidates < 2:
        return np.full((n_frames, len(ends)), np.nan)
    chosen = np.abs(candidates - poses[:, None]).max(-1).argmin(1)
    own = np.take_along_axis(errors, chosen[:, None], 1)
    tried = posed_joints(body, candidates.reshape(-1, body.n_dof))[:, ends]
    tried = tried.reshape(n_frames, n_candidates, len(ends), 3)
    moved = np.linalg.norm(tried - posed_joints(body, poses)[:, None, ends], axis=-1)
    excess = (errors - own) / np.maximum(np.abs(own), 1e-6)
    margins: np.ndarray = np.where(moved > ELSEWHERE, excess[..., None], np.inf).min(1)
    return np.maximum(margins, 0.0)


def limb_confidence(
    margins: np.ndarray,
    ends: np.ndarray,
    times: np.ndarray,
    disagreement: np.ndarray | None = None,
    regression: Regression = REGRESSION,
) -> np.ndarray:
    """Return (F, L) the probability that each limb is right, NaN where nothing is known.

    margins: (F, L), see `limb_margins`. ends: (F, L, 3) m, the limbs' ends at `times` (F,) s.
    disagreement: (F, L) m from the track's ends to the ways', their geometric mean; where it is
    known it says all.
    """
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    n = max(1, round(regression.window / step)) if step > 0 else 1
    capped = np.sqrt(np.clip(margins, 0.0, regression.most_margin))
    odds = regression.constant + regression.margin * _averaged(capped, n)
    odds = odds + regression.jitter * _averaged(_jitter(ends, times, regression.at_rest), n)
    if disagreement is not None:
        far = np.log(np.maximum(disagreement, regression.least) / regression.apart)
        known = _averaged(far, n)
        odds = np.where(np.isfinite(known), regression.disagreement * known, odds)
    confidence: np.ndarray = expit(odds)
    return confidence


def _jitter(ends: np.ndarray, times: np.ndarray, at_rest: float) -> np.ndarray:
    """(F, L) 1/s, acceleration over speed; of the first and last frame that of their neighbours."""
    if len(times) < 3:
        return np.zeros(ends.shape[:2])
    steps = np.diff(times)[:, None, None]
    velocities = np.diff(ends, axis=0) / np.maximum(steps, 1e-6)
    turns = np.diff(velocities, axis=0) / (0.5 * np.maximum(steps[1:] + steps[:-1], 1e-6))
    speeds = np.linalg.norm(velocities[:-1], axis=-1)
    found = np.linalg.norm(turns, axis=-1) / (speeds + at_rest)
    return np.concatenate([found[:1], found, found[-1:]])


def _averaged(values: np.ndarray, n: int) -> np.ndarray:
    """The means of values (F, L) over n (an odd number, n or n + 1) frames around each."""
    averaged: np.ndarray = uniform_filter1d(values, n + 1 - n % 2, axis=0, mode="nearest")
    return averaged
