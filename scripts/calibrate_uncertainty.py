#!/usr/bin/env python3
"""The constants of `apf.tracking.uncertainty.CALIBRATION`, from tracks whose truth is known.

    scripts/calibrate_uncertainty.py OUT/a=a/truth.npz ... --held-out OUT/b=b/truth.npz ...

takes folders of `apf track` (not smoothed, made with the constants in use) and prints the scale and
the floors with which the stated 95 % ellipsoids hold the truth in 95 % of the joint-frames, and in
how many of those held out, per joint; also of every walk (all tracks with the same truth) by a fit
to the other walks. Lost joints (by the rule of `apf evaluate` for limbs) are left out of the fit,
because a limb mistaken for another is no matter of millimetres; the last columns include them.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.table import Table

from apf.body.model import sideless
from apf.evaluation.evaluate import LOST_LIMB, evaluate, load_truth
from apf.tracking.track import Track
from apf.tracking.uncertainty import CALIBRATION, DeviationCalibration, is_inside_ellipsoid
from cl import InputError
from psfs.cli.commandline import add_message_flags, stdout
from psfs.cli.program import run_command

#: Scales that are tried, and bounds of the floors, m: at least the voxels' resolution.
_SCALES = (0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)
_LEAST_FLOOR, _MOST_FLOOR, _SHARE = 0.008, 0.3, 0.95
#: Largest mean radius, as a factor of the least, at which a larger scale is preferred: the scale
#: distinguishes frames in which a joint is well constrained from others, and the floors do not.
_SLACK = 1.03


@dataclass(frozen=True)
class Sample:
    """Offsets (N, 3) m of a joint from the truth, and its covariance (N, 3, 3) uncalibrated."""

    offsets: np.ndarray
    raw: np.ndarray

    def drop_lost(self) -> Sample:
        """Return the sample without the lost joints."""
        near = np.linalg.norm(self.offsets, axis=-1) <= LOST_LIMB
        return Sample(self.offsets[near], self.raw[near])

    def share(self, scale: float, floor: float) -> float:
        """Return the share of offsets inside their ellipsoids."""
        return float(
            is_inside_ellipsoid(self.offsets, self.covariance(scale, floor), _SHARE).mean()
        )

    def covariance(self, scale: float, floor: float) -> np.ndarray:
        return scale**2 * self.raw + floor**2 * np.eye(3)

    def floor(self, scale: float) -> float:
        """Return the least floor with which enough offsets are inside."""
        low, high = _LEAST_FLOOR, _MOST_FLOOR
        if self.share(scale, low) >= _SHARE:
            return low
        for _ in range(20):
            middle = (low + high) / 2
            low, high = (low, middle) if self.share(scale, middle) >= _SHARE else (middle, high)
        return high


def main() -> int:
    parser = argparse.ArgumentParser(
        prog="calibrate_uncertainty.py", description=__doc__.splitlines()[0]
    )
    parser.add_argument("tracks", nargs="+", metavar="TRACK=TRUTH")
    parser.add_argument("--held-out", nargs="+", default=[], metavar="TRACK=TRUTH")
    add_message_flags(parser)
    parser.set_defaults(run=_run)
    return run_command(parser)


def _run(args: argparse.Namespace) -> None:
    walks = samples_by_walk(args.tracks)
    samples = pool_samples(list(walks.values()))
    held_out = pool_samples(list(samples_by_walk(args.held_out).values()))
    near, held_near = _drop_lost(samples), _drop_lost(held_out)
    found = fit_calibration(near)
    stdout.print(f"scale = {found.scale:g}, floors in mm:")
    stdout.print({name: round(1000 * floor, 1) for name, floor in found.floor.items()})
    table = Table(title="Truth inside the stated 95 %", title_justify="left")
    columns = {
        "calibrated on": (near, found),
        "held out": (held_near, found),
        "held out, constants in use": (held_near, CALIBRATION),
        "calibrated on, lost ones too": (samples, found),
        "held out, lost ones too": (held_out, found),
    }
    for heading in ("joint", *columns):
        table.add_column(heading, justify="left" if heading == "joint" else "right")
    for name in samples:
        table.add_row(
            name, *(_format_share(_share(part, used, [name])) for part, used in columns.values())
        )
    table.add_section()
    table.add_row(
        "all", *(_format_share(_share(part, used, list(part))) for part, used in columns.values())
    )
    stdout.print(table)
    _tell_left_out({truth: _drop_lost(walk) for truth, walk in walks.items()})


def _tell_left_out(walks: dict[str, dict[str, Sample]]) -> None:
    """Print for each walk how often its truth lies inside, with a fit to the other walks."""
    if len(walks) < 2:
        return
    shares = []
    for truth, walk in walks.items():
        others = [other for name, other in walks.items() if name != truth]
        shares.append(_share(walk, fit_calibration(pool_samples(others)), list(walk)) or 0.0)
        stdout.print(f"{truth}: {shares[-1]:.1%} by a fit to the others", soft_wrap=True)
    stdout.print(f"mean of the walks: {np.mean(shares):.1%}")


def samples_by_walk(pairs: list[str]) -> dict[str, dict[str, Sample]]:
    """Return samples by the truth's file, then by joint. Raises InputError."""
    walks: dict[str, list[str]] = {}
    for pair in pairs:
        walks.setdefault(pair.partition("=")[2], []).append(pair)
    return {truth: load_samples(part) for truth, part in walks.items()}


def pool_samples(walks: list[dict[str, Sample]]) -> dict[str, Sample]:
    """Return the samples of several walks, by joint."""
    names = dict.fromkeys(name for walk in walks for name in walk)
    parts = {name: [walk[name] for walk in walks if name in walk] for name in names}
    return {
        name: Sample(np.concatenate([s.offsets for s in of]), np.concatenate([s.raw for s in of]))
        for name, of in parts.items()
    }


def load_samples(pairs: list[str]) -> dict[str, Sample]:
    """Return samples by joint, without its side. Raises InputError."""
    parts: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for pair in pairs:
        track, _, truth = pair.partition("=")
        if not truth:
            raise InputError(f"{pair}; expected a track and its truth, TRACK=TRUTH")
        tracked = Track.open(Path(track))
        found = evaluate(tracked, load_truth(truth))
        misfit = tracked.diagnostics["misfit"][np.isin(tracked.frames, found.frames)]
        growth = CALIBRATION.growth(misfit)[:, None]
        floors = CALIBRATION.floors(list(found.joint_names))
        raw = found.covariance / growth[..., None, None] ** 2
        raw -= floors[:, None, None] ** 2 * np.eye(3)
        raw /= CALIBRATION.scale**2
        for place, name in enumerate(found.joint_names):
            known = np.isfinite(found.inside[:, place])
            # Offsets relative to the growth are calibrated.
            kept = ((found.offsets / growth[..., None])[known, place], raw[known, place])
            parts.setdefault(sideless(name), []).append(kept)
    return {
        name: Sample(*(np.concatenate(column) for column in zip(*rows, strict=True)))
        for name, rows in parts.items()
    }


def fit_calibration(samples: dict[str, Sample]) -> DeviationCalibration:
    """Return a calibration with which enough offsets of every joint are inside.

    Of those whose ellipsoids are about as small as the smallest, see `_SLACK`, it has the largest
    scale.
    """
    radii: list[tuple[float, DeviationCalibration]] = []
    for scale in _SCALES:
        floors = {name: sample.floor(scale) for name, sample in samples.items()}
        volumes = [
            np.linalg.slogdet(sample.covariance(scale, floors[name]))[1]
            for name, sample in samples.items()
        ]
        radius = float(np.exp(np.concatenate(volumes).mean() / 6))
        radii.append((radius, DeviationCalibration(scale, floors)))
    least = min(radius for radius, _ in radii)
    return [found for radius, found in radii if radius <= _SLACK * least][-1]


def _drop_lost(samples: dict[str, Sample]) -> dict[str, Sample]:
    return {name: sample.drop_lost() for name, sample in samples.items()}


def _share(
    samples: dict[str, Sample], used: DeviationCalibration, names: list[str]
) -> float | None:
    shares, counts = [], []
    for name in names:
        if name in samples:
            sample = samples[name]
            shares.append(sample.share(used.scale, float(used.floors([name])[0])))
            counts.append(len(sample.offsets))
    return float(np.average(shares, weights=counts)) if shares else None


def _format_share(share: float | None) -> str:
    return "-" if share is None else f"{share:.1%}"


if __name__ == "__main__":
    sys.exit(main())
