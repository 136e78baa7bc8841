"""How good a track is, judged without truth: of the whole, and which frames and limbs to look at.

A limb is believed as the track says, see `apf.tracking.limb_confidence`. Trunk and head, and limbs
of tracks that say nothing of them, as far as their worst cone lies in the silhouettes, and as their
end is known: a wrong upper arm or thigh of the synthetic walks lies in them by 0.2 to 0.5, a wrong
forearm by 0.65, right ones by 0.87 and more.
"""

from __future__ import annotations

from collections.abc import Sequence as Items
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from apf.body.limbs import limb_names
from apf.report.agreement import Agreement, shown_rows
from apf.report.parts import parts_of, plain_name
from apf.tracking.limb_confidence import LOST
from apf.tracking.track import Track, spans

#: Share inside the silhouettes at which a part is as likely right as wrong.
_INSIDE = 0.7
_POWER = np.log(0.5) / np.log(_INSIDE)
#: m, deviation of a limb's end at which its confidence is halved: two of them are what `apf
#: evaluate` calls a lost limb.
_HALVED, _STEEPNESS = 0.1, 4
#: A part is to be looked at where its confidence is below this: where a limb counts as lost.
DOUBTFUL = LOST
#: Share of the surface voxels at the body below which a frame is to be looked at: something as
#: large as an arm is not explained. Hulls of few cameras leave up to 0.06 by themselves.
_EXPLAINED = 0.9
#: A track is good if at most this share of its frames is doubtful in any way, bad from that on.
_GOOD, _BAD = 0.02, 0.25
#: Ranges of frames that a line names; the page shows all.
_NAMED = 4


@dataclass(frozen=True, eq=False)
class Quality:
    """A track with its agreement with the silhouettes, if that was measured."""

    track: Track
    agreement: Agreement | None

    @cached_property
    def rows(self) -> np.ndarray:
        """(S,) rows of the track that are judged."""
        return shown_rows(len(self.track)) if self.agreement is None else self.agreement.rows

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """(P,) names of the parts."""
        return tuple(part.name for part in parts_of(self.track.its_body))

    @cached_property
    def confidence(self) -> np.ndarray:
        """(S, P) in [0, 1] of each part; 0 where the person was lost."""
        ends = [part.end for part in parts_of(self.track.its_body)]
        certain = 1 / (1 + (self.deviations[self.rows][:, ends] / _HALVED) ** _STEEPNESS)
        inside = 1.0 if self.agreement is None else self.agreement.inside
        confidence: np.ndarray = np.nan_to_num(certain * inside**_POWER, nan=0.0)
        names = limb_names(self.track.its_body)
        for limb, said in enumerate(self.track.limb_confidence[self.rows].T):
            if names[limb] in self.parts and np.isfinite(said).all():
                confidence[:, self.parts.index(names[limb])] = said
        confidence[self.track.lost[self.rows]] = 0.0
        return confidence

    @cached_property
    def deviations(self) -> np.ndarray:
        """(F, J) m, of each joint along the direction in which it is known least; 0 where the track
        states none."""
        known = np.nan_to_num(self.track.covariance)
        deviations: np.ndarray = np.sqrt(np.maximum(np.linalg.eigvalsh(known)[..., -1], 0.0))
        return deviations

    @cached_property
    def doubtful(self) -> dict[str, np.ndarray]:
        """Rows (n,) to look at by what is doubtful there: the person, parts, voxels unexplained."""
        found = {"the person, lost": np.flatnonzero(self.track.lost)}
        held = ~self.track.lost[self.rows]
        for number, part in enumerate(self.parts):
            found[part] = self.rows[(self.confidence[:, number] < DOUBTFUL) & held]
        if self.agreement is not None:
            unexplained = (self.agreement.explained < _EXPLAINED) & held
            found["voxels away from the body"] = self.rows[unexplained]
        return {what: rows for what, rows in found.items() if rows.size}

    @property
    def verdict(self) -> str:
        """good, doubtful or bad; unknown where nothing speaks against a track that was compared
        neither with the silhouettes nor with limbs elsewhere."""
        if not len(self.track):
            return "bad"
        rows = {row for rows in self.doubtful.values() for row in rows.tolist()}
        judged = {*self.rows.tolist(), *np.flatnonzero(self.track.lost).tolist()}
        share = len(rows) / len(judged)
        if share > _GOOD:
            return "doubtful" if share < _BAD else "bad"
        compared = self.agreement is not None or np.isfinite(self.track.limb_confidence).any()
        return "good" if compared else "unknown"

    def lines(self) -> list[str]:
        """Return what to tell: how good it is, then what to look at."""
        track, lost = self.track, int(self.track.lost.sum())
        facts = [f"{lost} of {len(track)} frames lost" if lost else "no frame lost"]
        if self.agreement is not None:
            means = camera_means(self.agreement.body_iou)
            worst = int(np.argmin(np.nan_to_num(means, nan=1.0)))
            facts.append(
                f"body and silhouettes overlap by {np.nanmean(means):.2f} (IoU; least in "
                f"{self.agreement.cameras[worst]}, {means[worst]:.2f})"
            )
        typical = np.median(self.deviations, axis=0)
        if typical.any():
            joint = int(typical.argmax())
            facts.append(
                f"joints known to {1000 * np.median(typical):.0f} mm (least the "
                f"{plain_name(track.joint_names[joint])}, {1000 * typical[joint]:.0f})"
            )
        looks = f"looks {self.verdict}"
        if self.verdict == "unknown":
            looks = "was not compared with the silhouettes"
        lines = [f"the track {looks}: {'; '.join(facts)}"]
        for what, rows in self.doubtful.items():
            ranges = self._ranges(rows)
            more = f" and {len(ranges) - _NAMED} more" if len(ranges) > _NAMED else ""
            shown = ", ".join(_range(*ends) for ends in ranges[:_NAMED])
            lines.append(f"look at {what}: frames {shown}{more}")
        return lines

    def _ranges(self, rows: np.ndarray) -> list[tuple[int, int]]:
        """Return first and last frame of every run of rows, as far as those judged go."""
        step = int(self.rows[1] - self.rows[0]) if len(self.rows) > 1 else 1
        runs = np.split(rows, np.flatnonzero(np.diff(rows) > step) + 1)
        frames = self.track.frames
        return [(int(frames[run[0]]), int(frames[run[-1]])) for run in runs]

    def facts(self) -> dict[str, Any]:
        """Return all figures as JSON has them."""
        track, found = self.track, self.agreement
        return {
            "verdict": self.verdict,
            "frames_judged": len(self.rows),
            "mean_confidence": _plain(np.nanmean(track.confidence))
            if np.isfinite(track.confidence).any()
            else None,
            "lost_frames": spans(track.frames[track.lost].tolist()),
            "lost_limbs": {
                name: spans(track.frames[column].tolist())
                for name, column in zip(limb_names(track.its_body), track.lost_limbs.T, strict=True)
            },
            "found_again_in_frames": spans(track.restarts.tolist()),
            "parts": {
                part: {"mean_confidence": _plain(values.mean()), "least": _plain(values.min())}
                for part, values in zip(self.parts, self.confidence.T, strict=True)
            },
            "joint_deviation_mm": {
                joint: _plain(1000 * value)
                for joint, value in zip(
                    track.joint_names, np.median(self.deviations, axis=0), strict=True
                )
            },
            "body_iou": _by_camera(found.cameras, found.body_iou) if found else None,
            "voxel_iou": _by_camera(found.cameras, found.voxel_iou) if found else None,
            "voxels_explained": _plain(np.nanmean(found.explained)) if found else None,
            "look_at": {what: self._ranges(rows) for what, rows in self.doubtful.items()},
        }


def camera_means(scores: np.ndarray) -> np.ndarray:
    """Return the means (V,) of scores (S, V), NaN where a camera has none."""
    means: np.ndarray = np.ma.filled(np.ma.masked_invalid(scores).mean(axis=0), np.nan)
    return means


def _by_camera(cameras: Items[str], scores: np.ndarray) -> dict[str, float | None]:
    means = camera_means(scores)
    return {name: _plain(value) for name, value in zip(cameras, means, strict=True)}


def _plain(value: float) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None


def _range(first: int, last: int) -> str:
    return f"{first}" if first == last else f"{first}-{last}"
