"""Remember, in one process, what is found in footage and in joints that many tests use.

Tests track copies of one walk again and again: each would diagnose the same pictures, find volume
and people in them, and fit the body to the same joints. What a test of these stages itself imports
is not remembered, but for the volume's box.
"""

import hashlib
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import wraps
from typing import Any

import numpy as np
import pytest

from apf.body.model import BodyModel
from apf.takes import people as people_of_takes
from apf.takes import start
from psfs.cameras.camera import CameraRig
from psfs.cli import check, info
from psfs.diagnostics import examination
from psfs.diagnostics.alignment import correct_rig
from psfs.diagnostics.examination import diagnose
from psfs.diagnostics.occluders import find_hidden_pixels
from psfs.people import people
from psfs.people.people import count_people
from psfs.session import Session
from psfs.volume import BoxSearch


@contextmanager
def remembered() -> Iterator[None]:
    """Remember the parts of `examine` and of `psfs check`, the box around what moves, the number of
    people, and the fit to given joints."""
    known: dict[Hashable, Any] = {}
    fit_to_joints, search_box = start.fit_to_joints, BoxSearch.run

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

    def count_once(session: Session, *more: Any) -> Any:
        key = count_people, *footage_key(session), repr((session.settings, more))
        return once(key, lambda: count_people(session, *more))

    def search_once(search: BoxSearch) -> Any:
        evidence = digest_of(search.evidence)
        key = BoxSearch, rig_key(search.rig), evidence, search.has_floor, search.min_cameras
        return once(key, lambda: search_box(search))

    def fit_once(body: BodyModel, joints: Mapping[str, np.ndarray]) -> Any:
        key = repr(body), tuple((name, np.asarray(at).tobytes()) for name, at in joints.items())
        fitted, pose, error = once(key, lambda: fit_to_joints(body, joints))
        return fitted, pose.copy(), error

    with pytest.MonkeyPatch.context() as patch:
        for stage in (diagnose, find_hidden_pixels, correct_rig):
            patch.setattr(examination, stage.__name__, find_once(stage))
        patch.setattr(check, diagnose.__name__, find_once(diagnose))
        for module in (people, people_of_takes, info):
            patch.setattr(module, "count_people", count_once)
        patch.setattr(BoxSearch, "run", search_once)
        patch.setattr(start, "fit_to_joints", fit_once)
        yield


def footage_key(session: Session) -> tuple[Hashable, ...]:
    """Return all that decides what is found in a session's footage."""
    sequence, digest = session.sequence, hashlib.sha1()
    for path in sorted(path for path in sequence.folder.rglob("*") if path.is_file()):
        digest.update(str(path.relative_to(sequence.folder)).encode() + path.read_bytes())
    stated = repr(sequence.settings.replace(cameras=None)), repr(session.reconstruction.silhouette)
    return digest.hexdigest(), *rig_key(sequence.rig), *stated, session.device.name


def rig_key(rig: CameraRig) -> tuple[Hashable, ...]:
    """Return all that distinguishes a rig from others."""
    arrays = ((c.K, c.distortion, c.R, c.t, c.hidden) for c in rig)
    known = [array for own in arrays for array in own if array is not None]
    facts = repr([(c.size, c.kappa, c.hidden is None, c.blur) for c in rig])
    return *rig.names, facts, digest_of(known)


def digest_of(arrays: Iterable[np.ndarray]) -> str:
    digest = hashlib.sha1()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
