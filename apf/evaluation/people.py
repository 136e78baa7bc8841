"""Several people compared with the truth: who is who, and the CLEAR MOT measures.

Bernardin and Stiefelhagen, Evaluating multiple object tracking performance: the CLEAR MOT metrics,
EURASIP Journal on Image and Video Processing 2008; IDF1: Ristani et al., Performance measures and a
data set for multi-target, multi-camera tracking, ECCV Workshops 2016.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from apf.evaluation.evaluate import Evaluation, evaluate, list_warnings
from apf.evaluation.joint_names import EVALUATED_JOINTS, evaluated_joints
from apf.evaluation.truth import load_people_truth
from apf.formats.trc import JointSeries
from apf.tracking.people import PeopleTracks
from apf.tracking.track import Track
from cl import InputError
from psfs.common.files import write_json
from psfs.common.numbers import known_means, match_pairs

#: A track whose joints lie farther than this, m, from a true person's on average is not theirs.
MATCHED = 0.5


@dataclass(frozen=True, eq=False)
class PeopleEvaluation:
    """Tracks of people against the truth.

    names: (P,) of the true people. matches: (F, P) number of the track that is matched to each one
    in each of `frames` (F,), -1 for none. present: (F, P) bool, frames in which the truth has the
    person. counts: (F,) number of people that the tracks show. tracks: (P,) number of the track
    that is a person's over all frames, -1 if none is. errors: (P,) the evaluation of each person
    by that track, None without a track. apart: mean distance, m, from the nearest track, of the
    person to whom it is least. warnings: for the reader of the figures.
    """

    names: tuple[str, ...]
    frames: np.ndarray
    matches: np.ndarray
    present: np.ndarray
    counts: np.ndarray
    tracks: np.ndarray
    errors: tuple[Evaluation | None, ...]
    apart: float
    warnings: tuple[str, ...]

    @property
    def count_right(self) -> float:
        """Share of the frames in which as many people are tracked as there are."""
        return float((self.counts == self.present.sum(1)).mean())

    @property
    def switches(self) -> list[tuple[int, str]]:
        """The frames in which a person is matched to another track than when last matched, each
        with the person's name."""
        switches = []
        for name, matched in zip(self.names, self.matches.T, strict=True):
            rows = np.flatnonzero(matched >= 0)
            changes = rows[1:][np.diff(matched[rows]) != 0]
            switches += [(int(self.frames[row]), name) for row in changes]
        return sorted(switches)

    @property
    def misses(self) -> int:
        """Number of person-frames that no track is matched to."""
        return int((self.present & (self.matches < 0)).sum())

    @property
    def false_positives(self) -> int:
        """Number of track-frames that are matched to nobody."""
        return int(self.counts.sum() - (self.matches >= 0).sum())

    @property
    def mota(self) -> float:
        """Multiple object tracking accuracy: 1 minus misses, false positives and switches per
        person-frame."""
        wrong = self.misses + self.false_positives + len(self.switches)
        return 1 - wrong / max(1, int(self.present.sum()))

    @property
    def idf1(self) -> float:
        """F1 score of the identities: how much of people and tracks is matched to the one track
        that is a person's over all frames."""
        right = (self.matches == self.tracks) & (self.tracks >= 0)
        return float(2 * right.sum() / max(1, self.present.sum() + self.counts.sum()))

    def summary(self) -> dict[str, Any]:
        """Return all figures, ready for JSON; errors in mm, None for a person without a track."""
        return {
            "n_frames": len(self.frames),
            "count_right": round(self.count_right, 5),
            "identity_switches": [[frame, name] for frame, name in self.switches],
            "misses": self.misses,
            "false_positives": self.false_positives,
            "mota": round(self.mota, 5),
            "idf1": round(self.idf1, 5),
            "warnings": list(self.warnings),
            "persons": [
                {
                    "name": name,
                    "track": None if track < 0 else int(track) + 1,
                    "matched_frames": int((self.matches[:, k] == track).sum()) if track >= 0 else 0,
                    "true_frames": int(self.present[:, k].sum()),
                    "errors": None if error is None else error.summary(),
                }
                for k, (name, track, error) in enumerate(
                    zip(self.names, self.tracks, self.errors, strict=True)
                )
            ],
        }

    def write_json(self, path: str | Path) -> None:
        """Write the `summary`."""
        write_json(Path(path), self.summary())


def find_followed(track: Track, truth: Mapping[str, JointSeries]) -> str:
    """Return the name of the true person who is nearest to a track, in the mean distance of joints.
    Raises InputError if no joint of several is known in any frame in common."""
    if len(truth) == 1:
        return next(iter(truth))
    errors: dict[str, float] = {}
    for name, series in truth.items():
        with suppress(InputError):
            errors[name] = evaluate(track, series).mean_error
    if not errors:
        raise InputError("the track and the truth have no joint in any frame in common")
    return min(errors, key=errors.__getitem__)


def evaluate_tracks(
    tracks: Sequence[Track], seen: Sequence[np.ndarray], path: Path
) -> list[Evaluation | None]:
    """Compare the tracks of a take's people with the truth in an npz, each with its person, see
    `evaluate_people`; None for a track without a person. seen: frames (F,) that show each person.
    Raises InputError."""
    truth = load_people_truth(path)
    if len(tracks) == 1:
        return [evaluate(tracks[0], truth[find_followed(tracks[0], truth)])]
    frames = np.unique(np.concatenate(list(seen)))
    result = evaluate_people(PeopleTracks(tuple(tracks), frames, tuple(seen)), truth)
    errors = dict(zip(result.tracks.tolist(), result.errors, strict=True))
    return [errors.get(number) for number in range(len(tracks))]


def evaluate_people(tracks: PeopleTracks, truth: Mapping[str, JointSeries]) -> PeopleEvaluation:
    """Compare the tracks of several people with the truth: in each frame matched by the distance of
    their joints, over all frames by the greatest number of matches.

    A match lasts as long as it is nearer than MATCHED; the others take the least sum
    of distances (CLEAR MOT). Frames without truth are left out. Raises InputError if a track and
    the truth have no joint in common.
    """
    truth = {name: series.at_rate(tracks[0].fps) for name, series in truth.items()}
    known = np.unique(np.concatenate([series.frames for series in truth.values()]))
    frames = np.intersect1d(tracks.frames, known)
    true = [_points(series, frames) for series in truth.values()]
    tracked = [_points(track, frames) for track in tracks]
    for points, seen in zip(tracked, tracks.seen, strict=True):
        points[~np.isin(frames, seen)] = np.nan
    away = [[np.linalg.norm(person - of, axis=-1) for of in tracked] for person in true]
    apart = np.stack([known_means(np.stack(of), axis=-1) for of in away])
    apart[np.isnan(apart)] = np.inf
    if not np.isfinite(apart).any():
        raise InputError("the tracks and the truth have no joint in any frame in common")
    nearest = apart.min(1)
    matches = _match(np.moveaxis(apart, -1, 0))
    votes = np.array([[(match == k).sum() for k in range(len(tracked))] for match in matches.T])
    chosen = np.full(len(true), -1)
    for k, track in match_pairs(-votes, 0):
        chosen[k] = track
    errors = tuple(
        None if k < 0 else evaluate(tracks.select_seen(int(k)), series)
        for k, series in zip(chosen, truth.values(), strict=True)
    )
    return PeopleEvaluation(
        names=tuple(truth),
        frames=frames,
        matches=matches,
        present=np.stack([np.isfinite(person).all(-1).any(-1) for person in true], axis=1),
        counts=tracks.counts[np.isin(tracks.frames, frames)],
        tracks=chosen,
        errors=errors,
        apart=min(row[np.isfinite(row)].mean() for row in nearest if np.isfinite(row).any()),
        warnings=tuple(
            dict.fromkeys(
                text for series in truth.values() for text in list_warnings(tracks.frames, series)
            )
        ),
    )


def _points(of: Track | JointSeries, frames: np.ndarray) -> np.ndarray:
    """Return the joints (F, 15, 3) that are compared in each of `frames`, NaN where missing."""
    points = np.full((len(frames), len(EVALUATED_JOINTS), 3), np.nan)
    _, rows, at = np.intersect1d(frames, of.frames, return_indices=True)
    points[rows] = evaluated_joints(of.joint_names, of.joints[at])[0]
    return points


def _match(apart: np.ndarray) -> np.ndarray:
    """Return the tracks (F, P) that are matched to the people, -1 for none, by their distances (F,
    P, K)."""
    matches = np.full(apart.shape[:2], -1)
    last = np.full(apart.shape[1], -1)
    for row, distances in enumerate(apart):
        matched: list[int] = []
        for k in np.argsort(distances[np.arange(len(last)), last]):
            if last[k] >= 0 and distances[k, last[k]] < MATCHED and last[k] not in last[matched]:
                matched.append(int(k))
        matches[row, matched] = last[matched]
        costs = distances.copy()
        costs[matched] = np.inf
        costs[:, last[matched]] = np.inf
        for k, track in match_pairs(costs, MATCHED):
            matches[row, k] = track
        last = np.where(matches[row] >= 0, matches[row], last)
    return matches
