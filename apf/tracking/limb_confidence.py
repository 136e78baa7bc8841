"""How far each limb of a track is to be believed, judged without truth.

A wrong arm mostly lies inside the silhouettes, laid along the body or into the trunk, and fits them
about as well as a right one: what gives it away is that the limb fits nearly as well elsewhere, and
that its end trembles. The limb search tries every limb elsewhere in every frame, so that both are
known without computing anything more on the device:

- the margin: by what share the error rises when the limb's end is moved, to the best other place
  that the search found,
- the jitter: the acceleration of the limb's end over its speed,

and of a take that was tracked both ways how far the ways have the limb's end apart, all as means
over a moment. They add up to log-odds by a logistic regression.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d

from apf.body.kinematics import posed_joints
from apf.body.limbs import limb_ends
from apf.body.model import BodyModel

#: m from the limb's end beyond which another candidate has it elsewhere.
ELSEWHERE = 0.15
#: A limb is lost where it is believed less than this.
LOST = 0.5


@dataclass(frozen=True)
class Regression:
    """The log-odds that a limb is right, as a sum."""

    constant: float
    """Log-odds of what has neither margin nor jitter, where tracks agree as well as usual."""
    margin: float
    """Per root of the margin."""
    jitter: float
    """Per 1/s of jitter."""
    disagreement: float
    """Per factor e of the distance to another track's end beyond `agreed`."""
    window: float = 0.4
    """s over which all are averaged."""
    most_margin: float = 0.3
    """Larger margins say no more."""
    at_rest: float = 0.5
    """m/s that is added to the speed, so that an end at rest does not tremble. By hand."""
    agreed: float = 0.1
    """m between two tracks' ends, by hand,"""
    least: float = 0.02
    """and below which a smaller distance says no more."""


#: Fitted by logistic regression on limbs beyond 200 mm and within 150 mm, as many of either, of
#: tracks of box, jacks, kick and run in the shared suite; the constants so that 4 % of the right
#: ones count as lost. Of a single track: of seven runs, 86 % of the wrong ones do; 85 % on pickup,
#: salsa and walks, with 4 % of the right ones.
ONE_WAY = Regression(constant=-12.9, margin=36.1, jitter=-0.033, disagreement=0.0)
#: Of one that was tracked both ways: of 20 runs, 97 of 98 wrong ones; on pickup, salsa and a walk,
#: 15 runs, 24 of 24, with 4 % of the right ones.
BOTH_WAYS = Regression(constant=-5.56, margin=10.46, jitter=-0.0148, disagreement=-5.25)


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
    regression: Regression | None = None,
) -> np.ndarray:
    """Return (F, L) the probability that each limb is right, NaN where no margin is known.

    margins: (F, L), see `limb_margins`. ends: (F, L, 3) m, the limbs' ends at `times` (F,) s.
    disagreement: (F, L) m, to the same ends of another track, NaN where there is none.
    """
    regression = regression or (ONE_WAY if disagreement is None else BOTH_WAYS)
    capped = np.sqrt(np.clip(margins, 0.0, regression.most_margin))
    steps = np.diff(times)
    n = 1 if not len(steps) else max(1, round(regression.window / float(np.median(steps))))
    odds = regression.constant + regression.margin * _averaged(capped, n)
    odds = odds + regression.jitter * _averaged(_jitter(ends, times, regression.at_rest), n)
    if disagreement is not None:
        apart = np.maximum(disagreement, regression.least) / regression.agreed
        odds = odds + regression.disagreement * _averaged(np.nan_to_num(np.log(apart)), n)
    confidence: np.ndarray = 1 / (1 + np.exp(-odds))
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
