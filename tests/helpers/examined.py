"""Remember, in one process, what is found in footage and in joints that many tests use.

Tests track copies of one walk again and again: each would diagnose the same pictures and fit the
body to the same joints. What a test of these stages itself imports is not remembered.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable, Iterator, Mapping
from contextlib import contextmanager
from functools import wraps
from typing import Any

import numpy as np
import pytest

import apf.api
from apf.body.model import BodyModel
from psfs.cli import check
from psfs.diagnostics import examination
from psfs.diagnostics.alignment import correct_rig
from psfs.diagnostics.camera_consistency import find_inconsistent_cameras
from psfs.diagnostics.faults import diagnose
from psfs.diagnostics.occluders import find_hidden_pixels
from psfs.session import Session


@contextmanager
def remembered() -> Iterator[None]:
    """Remember the parts of `examine` and of `psfs check`, and the fit to given joints."""
    known: dict[Hashable, Any] = {}
    fit_to_joints = apf.api.fit_to_joints

    def once(key: Hashable, compute: Callable[[], Any]) -> Any:
        if key not in known:
            known[key] = compute()
        return known[key]

    def find_once(stage: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(stage)
        def find(session: Session, *more: Any) -> Any:
            def compute() -> Any:
                return once((stage, *footage_key(session)), lambda: stage(session, *more))

            return session.compute_once(stage, compute) if stage is diagnose else compute()

        return find

    def fit_once(body: BodyModel, joints: Mapping[str, np.ndarray]) -> Any:
        key = repr(body), tuple((name, np.asarray(at).tobytes()) for name, at in joints.items())
        fitted, pose, error = once(key, lambda: fit_to_joints(body, joints))
        return fitted, pose.copy(), error

    with pytest.MonkeyPatch.context() as patch:
        for stage in (diagnose, find_hidden_pixels, correct_rig, find_inconsistent_cameras):
            patch.setattr(examination, stage.__name__, find_once(stage))
        for stage in (diagnose, find_inconsistent_cameras):
            patch.setattr(check, stage.__name__, find_once(stage))
        patch.setattr(apf.api, "fit_to_joints", fit_once)
        yield


def footage_key(session: Session) -> tuple[Hashable, ...]:
    """Return all that decides what is found in a session's footage."""
    sequence, digest = session.sequence, hashlib.sha1()
    for path in sorted(path for path in sequence.folder.rglob("*") if path.is_file()):
        digest.update(str(path.relative_to(sequence.folder)).encode() + path.read_bytes())
    for camera in sequence.rig:
        digest.update(repr((camera.size, camera.kappa)).encode())
        for array in (camera.K, camera.distortion, camera.R, camera.t, camera.hidden):
            digest.update(b"" if array is None else np.ascontiguousarray(array).tobytes())
    stated = repr(sequence.settings.replace(cameras=None)), repr(session.reconstruction.silhouette)
    return digest.hexdigest(), *sequence.rig.names, *stated, session.device.name
