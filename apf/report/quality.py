"""Judge a track without ground truth: its expected error, a verdict, and what to look at.

The expected error of the joints is that of three signs: the stated covariance, the parts that are
doubtful, and the silhouettes that the body leaves uncovered. The weights are those of a linear
regression on 22 tracks of laboratories, homes and fields, with errors of 21 to 76 mm, which they
predict to 16 % (a take left out: 17 %). Without silhouettes the others count more: on 142 tracks
of 67 takes, with errors of 16 to 380 mm, a take left out, 2 of 19 with more than 60 mm are called
good, and 3 of 95 with less than 35 mm are not.

A limb has the confidence that the track states, see `apf.tracking.limb_confidence`. Trunk and head,
and limbs of tracks without limb confidence, are judged by the share of their worst cone inside the
silhouettes and by the uncertainty of their end joint.
"""

from __future__ import annotations

from collections.abc import Sequence as Items
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from apf.body.limbs import limb_names
from apf.body.model import plain_name
from apf.report.agreement import VOXEL_FAR, Agreement, choose_rows, find_parts
from apf.tracking.limb_confidence import (
    LOST,
    LOST_LIMB,
    SAME_PLACE,
    lasts_long_enough,
)
from apf.tracking.retracking import list_corrections
from apf.tracking.track import Track, spans
from psfs.common.numbers import STEP_SECONDS, json_number, known_means, mean_known
from psfs.common.ranges import NAMED

#: A part with less confidence should be checked; a limb counts as lost below it, too.
DOUBTFUL = LOST
#: Expected error: per standard deviation of a joint, and of a joint of a doubtful part, m; the same
#: without silhouettes; of a body that covers half of the silhouettes, m; of a lost person, m.
_WITH_SILHOUETTES, _WITHOUT = (1 / 3, 0.035), (0.46, 0.117)
_ERROR_UNCOVERED, _ERROR_LOST = 0.075, 0.5
#: Share inside the silhouettes at which a part is as likely right as wrong: wrong upper arms and
#: thighs have 0.2 to 0.5, a wrong forearm 0.65, right parts 0.87 and more.
_INSIDE = 0.7
#: Standard deviation of a limb's end, m, that halves its confidence.
_HALVED = LOST_LIMB / 2
#: Share of surface voxels, or of keypoints, near the body below which a frame should be checked: an
#: arm is more than the rest; hulls of few cameras leave up to 0.06 without a fault; left and right
#: exchanged in one camera of five leaves 0.86 of the keypoints.
_EXPLAINED = 0.88
#: Greatest expected error of a good track and least one of a bad track, m: of 112 tracks of good
#: ones one had 2 % of its joints beyond 150 mm, of 23 others 17.
_GOOD, _BAD = 0.045, 0.075

#: What an interrupted track lacks.
INTERRUPTED = (
    "it was interrupted: later frames, or the backward pass over its last ones, are missing; the "
    "same apf track command makes it whole"
)


@dataclass(frozen=True, eq=False)
class Quality:
    """A track with its agreement with the silhouettes, if that was measured.

    seen: numbers (F_s,) of the frames that show one of several people; None for a single person.
    Where the person is not there, nothing is judged. near: (F,) share of the keypoints that
    lie near the body, None without keypoints. doubts: what is known to be wrong with the
    observations or the start; such a track is not called good.
    """

    track: Track
    agreement: Agreement | None
    near: np.ndarray | None = None
    doubts: tuple[str, ...] = ()
    seen: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.track.interrupted:
            object.__setattr__(self, "doubts", (*self.doubts, INTERRUPTED))

    @cached_property
    def there(self) -> np.ndarray:
        """Frames (F,) bool of the track that show the person."""
        if self.seen is None:
            return self.track.present
        return self.track.present & np.isin(self.track.frames, self.seen)

    @cached_property
    def lost(self) -> np.ndarray:
        """Frames (F,) bool that show the person, who is lost in them."""
        return self.track.lost & self.there

    @cached_property
    def rows(self) -> np.ndarray:
        """Rows (S,) of the track that are judged."""
        return choose_rows(len(self.track)) if self.agreement is None else self.agreement.rows

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """Names (P,) of the parts."""
        return tuple(part.name for part in find_parts(self.track.its_body))

    @cached_property
    def confidence(self) -> np.ndarray:
        """Confidence (S, P) in [0, 1] of each part; 0 where the person was lost."""
        ends = [part.end for part in find_parts(self.track.its_body)]
        certain = 0.5 ** (self.deviations[self.rows][:, ends] / _HALVED) ** 2
        inside = 1.0 if self.agreement is None else self.agreement.inside
        power = np.log(0.5) / np.log(_INSIDE)
        confidence: np.ndarray = np.nan_to_num(certain * inside**power, nan=0.0)
        names = limb_names(self.track.its_body)
        for limb, stated in enumerate(self.track.limb_confidence[self.rows].T):
            if names[limb] in self.parts and np.isfinite(stated).all():
                confidence[:, self.parts.index(names[limb])] = stated
        confidence[self.track.lost[self.rows]] = 0.0
        return confidence

    @cached_property
    def deviations(self) -> np.ndarray:
        """Standard deviation (F, J) m of each joint along its least certain direction; 0 if
        unknown."""
        known = np.nan_to_num(self.track.covariance)
        return np.sqrt(np.maximum(np.linalg.eigvalsh(known)[..., -1], 0.0))

    @cached_property
    def doubtful(self) -> dict[str, np.ndarray]:
        """Rows (n,) to check, by what is doubtful there: the person, a part, or unexplained
        voxels."""
        found = {"the person, lost": np.flatnonzero(self.lost)}
        held = (~self.track.lost & self.there)[self.rows]
        for number, part in enumerate(self.parts):
            found[part] = self.rows[(self.confidence[:, number] < DOUBTFUL) & held]
        if self.agreement is not None:
            unexplained = (self.agreement.explained < _EXPLAINED) & held
            found["voxels away from the body"] = self.rows[unexplained]
        if self.near is not None:
            apart = (self.near[self.rows] < _EXPLAINED) & held
            found["keypoints away from the body"] = self.rows[apart]
        return {what: rows for what, rows in found.items() if rows.size}

    @cached_property
    def expected_error(self) -> float:
        """Expected mean error of the joints, m; NaN for a track without frames of the person.

        Of the person in a frame in which they are lost `_ERROR_LOST` is expected, of keypoints and
        voxels away from the body the distance from which on they are.
        """
        there = int(self.there.sum())
        if not there:
            return float("nan")
        held = ~self.track.lost & self.there
        rows = held[self.rows]
        spreads = np.sqrt(np.trace(np.nan_to_num(self.track.covariance[held]), axis1=2, axis2=3))
        per_spread, doubtful = _WITHOUT if self.agreement is None else _WITH_SILHOUETTES
        error = per_spread * mean_known(spreads)
        error += doubtful * (1 - mean_known(self.confidence[rows], nothing=1.0))
        if self.agreement is not None:
            of_body, of_voxels = self.agreement.body_iou[rows], self.agreement.voxel_iou[rows]
            overlap = mean_known(of_body) / mean_known(of_voxels)
            error += _ERROR_UNCOVERED * max(1 / max(overlap, 0.01) - 1, 0.0)
            error += VOXEL_FAR * (1 - mean_known(self.agreement.explained[rows], nothing=1.0))
        if self.near is not None:
            error += SAME_PLACE * (1 - mean_known(self.near[held], nothing=1.0))
        lost = float(self.lost.sum()) / there
        return (1 - lost) * float(error) + lost * _ERROR_LOST

    @property
    def verdict(self) -> str:
        """The verdict by the expected error: good, doubtful, bad or unknown.

        A good one is doubtful if something is known to be wrong, see `doubts`. It is unknown if the
        track was compared neither with the silhouettes nor with keypoints nor with limbs elsewhere,
        or is too short for its limbs to be judged.
        """
        if not self.expected_error < _BAD:
            return "bad"
        if self.expected_error > _GOOD or self.doubts:
            return "doubtful"
        return "good" if self._compared and lasts_long_enough(self.track.times) else "unknown"

    @property
    def _compared(self) -> bool:
        limbs = bool(np.isfinite(self.track.limb_confidence).any())
        return self.agreement is not None or self.near is not None or limbs

    def lines(self) -> list[str]:
        """Return lines for the user: the verdict, then what to check."""
        track, lost, n_there = self.track, int(self.lost.sum()), int(self.there.sum())
        facts = [f"{lost} of {n_there} frames lost" if lost else "no frame lost"]
        if n_there < len(track):
            facts.append(f"not there in frames {spans(track.frames[~self.there].tolist(), NAMED)}")
        if self.agreement is not None:
            means = known_means(self.agreement.body_iou)
            worst = int(np.argmin(np.nan_to_num(means, nan=1.0)))
            facts.append(
                f"the body covers the silhouettes to {np.nanmean(means):.2f}, the voxels, which it "
                f"can at best reach, to {np.nanmean(self.agreement.voxel_iou):.2f} (IoU; least in "
                f"{self.agreement.cameras[worst]}, {means[worst]:.2f})"
            )
        typical = np.median(self.deviations, axis=0)
        if typical.any():
            joint = int(typical.argmax())
            facts.append(
                f"typical joint uncertainty {1000 * np.median(typical):.0f} mm, worst: "
                f"{plain_name(track.joint_names[joint])}, {1000 * typical[joint]:.0f} mm"
            )
        if self.near is not None and np.isfinite(self.near).any():
            facts.append(f"{np.nanmean(self.near):.0%} of the keypoints near the body")
        looks = f"looks {self.verdict}"
        if self.verdict == "unknown" and not self._compared:
            looks = "was not compared with the silhouettes"
        elif self.verdict == "unknown":
            looks = (
                f"lasts for less than {STEP_SECONDS:g} s, too short to say whether its "
                "limbs are right"
            )
        if np.isfinite(self.expected_error):
            expected, good, bad = (1000 * error for error in (self.expected_error, _GOOD, _BAD))
            scale = f"good: up to {good:.0f}, bad: from {bad:.0f}"
            facts.insert(0, f"expected joint error {expected:.0f} mm ({scale})")
        lines = [f"the track {looks}: {'; '.join(facts)}", *list_corrections(track)]
        lines += [f"in doubt because {doubt}" for doubt in self.doubts]
        for what, rows in self.doubtful.items():
            ranges = self._ranges(rows)
            more = f" and {len(ranges) - NAMED} more" if len(ranges) > NAMED else ""
            shown = ", ".join(spans(range(a, b + 1)) for a, b in ranges[:NAMED])
            lines.append(f"look at {what}: frames {shown}{more}")
        return lines

    def _ranges(self, rows: np.ndarray) -> list[tuple[int, int]]:
        """Return the first and last frame of every run of rows, with gaps up to the judged rows'
        spacing."""
        step = int(self.rows[1] - self.rows[0]) if len(self.rows) > 1 else 1
        runs = np.split(rows, np.flatnonzero(np.diff(rows) > step) + 1)
        frames = self.track.frames
        return [(int(frames[run[0]]), int(frames[run[-1]])) for run in runs]

    def facts(self) -> dict[str, object]:
        """Return all figures in JSON types."""
        track, found, doubts = self.track, self.agreement, list(self.doubts)
        share = np.nan if self.near is None else float(np.nanmean(self.near))
        far = f"only {share:.0%} of the keypoints are near the body"
        if share < _EXPLAINED and far not in doubts:  # also for `apf report`, without keypoints
            doubts.append(far)
        return {
            "verdict": self.verdict,
            "expected_error_mm": json_number(1000 * self.expected_error),
            "frames_judged": len(self.rows),
            "mean_confidence": json_number(mean_known(track.confidence)),
            "lost_frames": spans(track.frames[self.lost].tolist()),
            "absent_frames": spans(track.frames[~self.there].tolist()),
            "lost_limbs": {
                name: spans(track.frames[column].tolist())
                for name, column in zip(limb_names(track.its_body), track.lost_limbs.T, strict=True)
            },
            "found_again_in_frames": spans(track.restarts.tolist()),
            "parts": {
                part: {"mean_confidence": json_number(of.mean()), "least": json_number(of.min())}
                for part, of in zip(self.parts, self.confidence.T, strict=True)
            },
            "joint_deviation_mm": {
                joint: json_number(1000 * value) if value else None  # None where nothing is stated
                for joint, value in zip(
                    track.joint_names, np.median(self.deviations, axis=0), strict=True
                )
            },
            "body_iou": _name_cameras(found.cameras, found.body_iou) if found else None,
            "voxel_iou": _name_cameras(found.cameras, found.voxel_iou) if found else None,
            "voxels_explained": json_number(mean_known(found.explained)) if found else None,
            "keypoints_near": None if self.near is None else json_number(mean_known(self.near)),
            "doubts": doubts,
            "look_at": {what: self._ranges(rows) for what, rows in self.doubtful.items()},
        }


def _name_cameras(cameras: Items[str], scores: np.ndarray) -> dict[str, float | None]:
    means = known_means(scores)
    return {name: json_number(value) for name, value in zip(cameras, means, strict=True)}
