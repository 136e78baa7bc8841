"""Errors of a track against the truth, joint by joint and frame by frame."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from apf.body.limbs import LIMB_ENDS, limb_joints, limb_names
from apf.evaluation.angle_truth import AngleError, summarise_angles
from apf.evaluation.joint_names import EVALUATED_JOINTS, TOES, evaluated_joints, match_joints
from apf.formats.joint_csv import write_columns
from apf.formats.trc import JointSeries
from apf.tracking.limb_confidence import LOST_LIMB, SAME_PLACE
from apf.tracking.track import Track
from apf.tracking.uncertainty import is_inside_ellipsoid
from cl import InputError
from psfs.common.files import write_json
from psfs.common.numbers import find_true_runs, json_number, mean_known

#: A joint farther than this from the truth, m, counts as lost in that frame.
LOST_JOINT = SAME_PLACE
#: A limb counts as lost if its end is farther than LOST_LIMB from the truth in more than so many
#: consecutive frames, or in the last frame.
LOST_FRAMES = 10


class FlagCounts(NamedTuple):
    """Numbers of limb-frames: reported as lost and all, of those with an error above 200 mm;
    reported as lost and all, of those with an error below 150 mm."""

    far_flagged: int
    far: int
    near_flagged: int
    near: int

    @property
    def found(self) -> float:
        """Share of the wrong limb-frames that are reported; NaN if there are none."""
        return self.far_flagged / self.far if self.far else float("nan")

    @property
    def falsely(self) -> float:
        """Share of the right limb-frames that are reported; NaN if there are none."""
        return self.near_flagged / self.near if self.near else float("nan")


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Errors of a track against the truth.

    joint_names: (J,) compared ones, out of EVALUATED_JOINTS. frames: (F,) compared indices. fps: of
    the track. offsets: (F, J, 3) m, track minus truth in the world, NaN where the truth is missing.
    body_frames: (F, 3, 3) columns forward, left, up of the true body, NaN without hips and neck; or
    (F, J, 3, 3) axes of the bone that carries each point. covariance: (F, J, 3, 3) m^2 reported by
    the track, else NaN. lost: (F,) frames that the track reports as lost; they count like all
    others. unmatched_track, unmatched_truth: names not compared. n_ignored: joint-frames without
    truth. warnings: for the reader of the figures. predicted_lost_fraction: share of the frames in
    which the track reports a limb as lost, by name; flagged: (F, J) bool, joints of such limbs in
    these frames; they count like all others. angles: errors of the joint angles, if the truth has
    rotations. toes: of their tips, if both have them.
    """

    joint_names: tuple[str, ...]
    frames: np.ndarray
    fps: float
    offsets: np.ndarray
    body_frames: np.ndarray
    covariance: np.ndarray
    lost: np.ndarray
    unmatched_track: tuple[str, ...]
    unmatched_truth: tuple[str, ...]
    n_ignored: int
    warnings: tuple[str, ...]
    predicted_lost_fraction: dict[str, float] = field(default_factory=dict)
    flagged: np.ndarray = field(default_factory=lambda: np.zeros((0, 0), bool))
    angles: tuple[AngleError, ...] = ()
    toes: Evaluation | None = None

    @cached_property
    def errors(self) -> np.ndarray:
        """Distances (F, J), m; NaN where the truth is missing."""
        return np.linalg.norm(self.offsets, axis=-1)

    @cached_property
    def frame_errors(self) -> np.ndarray:
        """Mean distance (F,) over the joints, m."""
        return np.nanmean(self.errors, axis=1)

    @property
    def mean_error(self) -> float:
        """Mean over all joint-frames, m."""
        return float(np.nanmean(self.errors))

    @property
    def lost_share(self) -> float:
        """Share of joint-frames farther than LOST_JOINT from the truth."""
        return float(np.mean(self.errors[np.isfinite(self.errors)] > LOST_JOINT))

    @cached_property
    def constant_and_rest(self) -> tuple[np.ndarray, np.ndarray]:
        """Constant part (J,) m of the error, and mean (J,) m of the rest.

        The constant part is the norm of the median offset in the body's own frame (forward, left,
        up from hips and neck): the joint is defined elsewhere in the body, which no better tracking
        can change. The rest is the mean distance after that offset is subtracted. NaN if hips or
        neck are not known.
        """
        axes = self.body_frames if self.body_frames.ndim == 4 else self.body_frames[:, None]
        local = np.einsum(
            "fkij,fki->fkj", np.broadcast_to(axes, (*self.offsets.shape, 3)), self.offsets
        )
        with warnings.catch_warnings():  # joints that are NaN in all frames stay NaN
            warnings.simplefilter("ignore", RuntimeWarning)
            constant = np.nanmedian(local, axis=0)
            rest = np.nanmean(np.linalg.norm(local - constant, axis=-1), axis=0)
        return np.linalg.norm(constant, axis=-1), rest

    @cached_property
    def inside(self) -> np.ndarray:
        """Indicator (F, J): 1 where the truth lies inside the 95 % ellipsoid, 0 where not, NaN
        where the track reports no covariance."""
        within = np.full(self.errors.shape, np.nan)
        known = np.isfinite(self.covariance).all((-2, -1)) & np.isfinite(self.errors)
        within[known] = is_inside_ellipsoid(self.offsets[known], self.covariance[known])
        return within

    @cached_property
    def inside_unflagged(self) -> float:
        """Share of joint-frames within their 95 % ellipsoids, of those whose limb the track does
        not report as lost; NaN if it reports no covariance."""
        known = np.isfinite(self.inside) & ~self.flagged & ~self.lost[:, None]
        return mean_known(self.inside[known])

    @cached_property
    def flags(self) -> FlagCounts:
        """Counts of limbs that the track reports as lost, rightly and wrongly."""
        limbs = [end for limb, end in LIMB_ENDS.items() if limb != "head"]
        ends = [self.joint_names.index(end) for end in limbs if end in self.joint_names]
        errors, flagged = self.errors[:, ends], (self.flagged | self.lost[:, None])[:, ends]
        bad, good = errors > LOST_LIMB, errors <= LOST_JOINT
        counts = (bad & flagged, bad, good & flagged, good)
        return FlagCounts(*(int(count.sum()) for count in counts))

    @cached_property
    def lost_limbs(self) -> dict[str, bool]:
        """Lost limbs by name, of those whose end is compared; see LOST_LIMB."""
        return {
            limb: _is_lost(self.errors[:, self.joint_names.index(end)])
            for limb, end in LIMB_ENDS.items()
            if end in self.joint_names
        }

    def joint_table(self) -> list[dict[str, Any]]:
        """Return a row per joint: its name, mean, median, max, constant and rest error in mm, and
        the share of frames in which it lies inside its 95 % ellipsoid."""
        constant, rest = self.constant_and_rest
        columns = {
            "mean_mm": np.nanmean(self.errors, axis=0),
            "median_mm": np.nanmedian(self.errors, axis=0),
            "max_mm": np.nanmax(self.errors, axis=0),
            "constant_mm": constant,
            "rest_mm": rest,
        }
        return [
            {"joint": name}
            | {key: json_number(1000 * column[j], 2) for key, column in columns.items()}
            | {"inside_95": json_number(mean_known(self.inside[:, j]))}
            for j, name in enumerate(self.joint_names)
        ]

    def summary(self) -> dict[str, Any]:
        """Return all figures, ready for JSON; errors in mm, None where not known."""
        constant, rest = self.constant_and_rest
        return {
            "mean_error_mm": json_number(1000 * self.mean_error, 2),
            "median_error_mm": json_number(1000 * np.nanmedian(self.errors), 2),
            "max_error_mm": json_number(1000 * np.nanmax(self.errors), 2),
            "constant_mm": json_number(1000 * constant.mean(), 2),
            "rest_mm": json_number(1000 * rest.mean(), 2),
            "lost_joint_share": round(self.lost_share, 5),
            "lost_limbs": [limb for limb, lost in self.lost_limbs.items() if lost],
            "limbs_said_to_be_lost": {
                n: round(share, 5) for n, share in self.predicted_lost_fraction.items()
            },
            "limbs_beyond_200_mm_flagged": json_number(self.flags.found),
            "limbs_within_150_mm_flagged": json_number(self.flags.falsely),
            "inside_95": json_number(mean_known(self.inside)),
            "inside_95_unflagged": json_number(self.inside_unflagged),
            "lost_frames": self.frames[self.lost].tolist(),
            "n_frames": len(self.frames),
            "n_joints": len(self.joint_names),
            "n_joint_frames_ignored": self.n_ignored,
            "not_compared": {
                "track": list(self.unmatched_track),
                "truth": list(self.unmatched_truth),
            },
            "warnings": list(self.warnings),
            "joints": self.joint_table(),
            "toes": self.toes.joint_table() if self.toes is not None else [],
            **summarise_angles(self.angles),
        }

    def write_json(self, path: str | Path) -> None:
        """Write the `summary`."""
        write_json(Path(path), self.summary())

    def write_csv(self, path: str | Path) -> None:
        """Write one row per frame: frame, time_s, mean_mm, then <joint>_mm, blank without truth."""
        names = ["mean_mm", *(f"{name}_mm" for name in self.joint_names)]
        errors = 1000 * np.column_stack([self.frame_errors, self.errors])
        write_columns(path, self.frames, self.fps, dict(zip(names, errors.T, strict=True)), 2)


def evaluate(track: Track | JointSeries, truth: JointSeries) -> Evaluation:
    """Compare a track with the truth: frames matched by index, or by time if the rates differ (see
    `JointSeries.at_rate`), joints by name.

    Raises InputError if they have no frame or no joint in common.
    """
    truth = truth.at_rate(track.fps)
    ours, our_names, our_unused = evaluated_joints(track.joint_names, track.joints)
    true, true_names, true_unused = evaluated_joints(truth.joint_names, truth.joints)
    names = [name for name in our_names if name in true_names]
    if not names:
        raise InputError(
            f"no joint in common: the track has {', '.join(track.joint_names)}; "
            f"the truth has {', '.join(truth.joint_names)}"
        )
    frames, rows, true_rows = common_frames(track, truth)
    columns = [EVALUATED_JOINTS.index(name) for name in names]
    offsets = ours[rows][:, columns] - true[true_rows][:, columns]
    stated = np.full((len(rows), len(names), 3, 3), np.nan)
    if isinstance(track, Track):
        reported = match_joints(track.joint_names)
        for j, name in enumerate(names):
            if name in reported:
                stated[:, j] = track.covariance[rows, reported[name]]
    axes = _body_frames(true[true_rows])
    common = frames, rows
    result = evaluate_points(track, truth, common, tuple(names), offsets, axes, covariance=stated)
    compared = result.joint_names
    points = track.points if isinstance(track, Track) else track
    our_toes, true_toes = (match_joints(of.joint_names, TOES) for of in (points, truth))
    toes = tuple(name for name in TOES if name in our_toes and name in true_toes)
    offsets = points.joints[rows][:, [our_toes[name] for name in toes]]
    offsets = offsets - truth.joints[true_rows][:, [true_toes[name] for name in toes]]
    known = np.isfinite(offsets).all(-1).any()
    return replace(
        result,
        toes=evaluate_points(track, truth, common, toes, offsets, axes) if known else None,
        unmatched_track=tuple(our_unused + [name for name in our_names if name not in compared]),
        unmatched_truth=tuple(true_unused + [name for name in true_names if name not in compared]),
    )


def common_frames(
    track: Track | JointSeries, truth: JointSeries
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the common frames (F,), and their rows in track and truth. Raises InputError if there
    are none."""
    frames, rows, true_rows = np.intersect1d(track.frames, truth.frames, return_indices=True)
    if not frames.size:
        raise InputError(
            f"no frame in common: the track has {_span(track.frames)}, "
            f"the truth {_span(truth.frames)}"
        )
    return frames, rows, true_rows


def evaluate_points(
    track: Track | JointSeries,
    truth: JointSeries,
    common: tuple[np.ndarray, np.ndarray],
    names: tuple[str, ...],
    offsets: np.ndarray,
    axes: np.ndarray,
    *,
    covariance: np.ndarray | None = None,
) -> Evaluation:
    """Return the evaluation of points `names` with offsets (F, J, 3), m, in the common frames.

    common: the frames, and their rows in the track. Points and frames without truth are left out.
    axes: the `body_frames`. covariance: (F, J, 3, 3) m^2. Raises InputError if nothing has truth.
    """
    frames, rows = common
    missing = np.any(~np.isfinite(offsets), axis=-1)
    offsets = np.where(missing[..., None], np.nan, offsets)
    compared, with_truth = ~missing.all(axis=1), ~missing.all(axis=0)
    if not compared.any():
        raise InputError("the truth is missing (NaN) in every frame of the track")
    if covariance is None:
        covariance = np.full((*offsets.shape, 3), np.nan)
    lost, flagged, shares = _read_flags(track, names, rows[compared])
    return Evaluation(
        joint_names=tuple(name for name, known in zip(names, with_truth, strict=True) if known),
        frames=frames[compared],
        fps=track.fps,
        offsets=offsets[compared][:, with_truth],
        body_frames=axes[compared] if axes.ndim == 3 else axes[compared][:, with_truth],
        covariance=covariance[compared][:, with_truth],
        lost=lost,
        unmatched_track=(),
        unmatched_truth=(),
        n_ignored=int(missing.sum()),
        warnings=list_warnings(track.frames, truth),
        predicted_lost_fraction=shares,
        flagged=flagged[:, with_truth],
    )


def _read_flags(
    track: Track | JointSeries, names: tuple[str, ...], rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
    """Return what a track reports in `rows`: where the person is lost (F,), which joints belong to
    lost limbs (F, J), and the share of frames in which each limb is lost, if it ever is. Points
    that are no joints of the track belong to no limb."""
    flagged = np.zeros((len(rows), len(names)), bool)
    if not isinstance(track, Track):
        return np.zeros(len(rows), bool), flagged, {}
    if track.body is None:
        return track.lost[rows], flagged, {}
    limbs = track.lost_limbs[rows]
    columns, gone = match_joints(track.joint_names), limbs @ limb_joints(track.body)
    for j, name in enumerate(names):
        if name in columns:
            flagged[:, j] = gone[:, columns[name]]
    shares = zip(limb_names(track.body), limbs.mean(axis=0).tolist(), strict=True)
    return track.lost[rows], flagged, {name: share for name, share in shares if share}


def _body_frames(joints: np.ndarray) -> np.ndarray:
    """Return axes (F, 3, 3), columns forward, left, up, of joints (F, 15, 3), from the hips and the
    neck."""
    l_hip, r_hip, neck = (
        joints[:, EVALUATED_JOINTS.index(name)] for name in ("l_hip", "r_hip", "neck")
    )
    left = l_hip - r_hip
    forward = np.cross(left, neck - (l_hip + r_hip) / 2)
    axes = np.stack([forward, left, np.cross(forward, left)], axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return axes / np.linalg.norm(axes, axis=1, keepdims=True)


def _is_lost(errors: np.ndarray) -> bool:
    """Return whether a limb whose end has these errors (F,), m, was lost; frames without truth are
    ignored."""
    far = errors[np.isfinite(errors)] > LOST_LIMB
    longest = max((run.stop - run.start for run in find_true_runs(far)), default=0)
    return bool(longest > LOST_FRAMES or far[-1:].any())


def list_warnings(frames: np.ndarray, truth: JointSeries) -> tuple[str, ...]:
    """Return what a reader of the figures should know: tracked `frames` that the truth lacks."""
    n_common = int(np.isin(frames, truth.frames).sum())
    if n_common == len(frames):
        return ()
    return (f"the truth covers {n_common} of the track's {len(frames)} frames",)


def _span(frames: np.ndarray) -> str:
    return f"frames {frames.min()}..{frames.max()}" if frames.size else "no frames"
