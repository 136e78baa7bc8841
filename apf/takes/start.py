"""The start of a take: stated by the request, or else found in the first voxels."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from apf.body.bodytrack import is_bodytrack, read_body
from apf.body.model import BodyModel
from apf.body.toml import load_body
from apf.evaluation.joint_names import match_joints
from apf.evaluation.truth import load_truth
from apf.formats.pose import check_pose, read_pose
from apf.formats.trc import JointSeries
from apf.initialisation.from_joints import fit_to_joints
from apf.initialisation.sequence import initialise
from apf.initialisation.start import Start, StartError
from apf.request import StartRequest
from apf.tracking.settings import DEFAULT_BODY, GivenStart
from cl import InputError
from psfs.common.files import name_file_in_errors
from psfs.common.ranges import check_number
from psfs.sequence import Sequence
from psfs.session import Session

#: Least and greatest stature of a person, m.
STATURES = (0.5, 2.5)


def check_start(request: StartRequest, truth: Path | None = None) -> None:
    """Raise InputError for an impossible height, and for flags that have no effect; truth: a file
    of joints, whose axes may be stated."""
    if request.init is not None:
        request.refuse(["height"], "applies only to an automatic start; expected none with --init")
    joints = [path for path in (request.init, truth) if isinstance(path, Path)]
    if not any(path.suffix.lower() == ".trc" for path in joints):
        request.refuse(["convention"], "applies only to a TRC; expected one as --init with it")
    if request.height is not None:
        check_number("--height, m,", request.height, *STATURES)


def load_template(body: BodyModel | str | Path | None) -> tuple[BodyModel, bool]:
    """Return the body to start with, and whether it comes from a file and so has the person's own
    shape."""
    if isinstance(body, BodyModel):
        return body, False
    return load_body(body or DEFAULT_BODY), body is not None and Path(body).suffix == ".toml"


def read_given_start(
    folder: Path,
    frame: int,
    body: BodyModel | str | Path | None = None,
    init: np.ndarray | str | Path | None = None,
    convention: str = "y-up",
) -> GivenStart | None:
    """Return the body and its pose (D,) in `frame`, the first to be tracked; None if none is given.

    Without `body`, the sequence's own is used if its `folder` has one, with its own first pose.
    body, init: as of `apf.track`. convention: axes of a TRC. Raises InputError.
    """
    own = body is None and is_bodytrack(folder)
    model = read_body(folder) if own else load_template(body)[0]
    if init is None:
        return (model, model.rest_pose) if own else None
    if isinstance(init, np.ndarray):
        if init.shape != (model.n_dof,) or init.dtype.kind not in "iuf":
            raise InputError(
                f"init is {init.dtype} of shape {init.shape}; expected ({model.n_dof},) numbers"
            )
        check_pose(init, model, "init")
        return model, init
    path = Path(init)
    if path.suffix.lower() not in (".npz", ".trc"):
        return model, read_pose(path, model)
    truth = load_truth(path, convention)
    if frame not in truth.frames:
        raise InputError(f"{path}: no joints for frame {frame}, the first to be tracked")
    with name_file_in_errors(path):
        return fit_to_truth(model, truth, frame)


def fit_to_truth(template: BodyModel, truth: JointSeries, frame: int) -> GivenStart:
    """Return the body and its pose (D,) fitted to the joints of a frame. Raises InputError."""
    joints, columns = truth.joints[truth.frames == frame][0], match_joints(truth.joint_names)
    body, pose, _ = fit_to_joints(template, {n: joints[column] for n, column in columns.items()})
    return body, pose


def find_first_pose(
    session: Session,
    request: StartRequest,
    progress: Callable[[], object] | None,
    warn: Callable[[str], Any],
    number: int | None = None,
) -> GivenStart:
    """Return the body and its first pose (D,) found in the voxels; a body from a file keeps its
    shape. number: of one of several people, counted from 1, for messages."""
    template, keep_shape = load_template(request.body)
    seed = request.method.filter.search.seed
    with explain_failed_start(session.sequence, number):
        found = initialise(
            session, template, height=request.height, keep_shape=keep_shape, seed=seed,
            progress=progress,
        )  # fmt: skip
    warn_of_doubts(session.sequence, found, warn, number)
    return found.body, found.poses[0]


@contextmanager
def explain_failed_start(sequence: Sequence, number: int | None = None) -> Iterator[None]:
    """Add to the error of a failed start the name of the sequence, the number of one of several
    people, and the flags that help."""
    try:
        yield
    except StartError as error:
        instead = "; --frames a: begins at another frame"
        if number is None:  # --init is of one person
            instead += ", --init gives a first pose instead"
        raise StartError(f"{_name(sequence, number)}: {error}{instead}") from None


def warn_of_doubts(
    sequence: Sequence, start: Start, warn: Callable[[str], Any], number: int | None = None
) -> None:
    """Warn of the doubts about an automatic start; number: of one of several people."""
    instead = ", or give --init" if number is None else ""
    for doubt in start.doubts:
        warn(f"{_name(sequence, number)}: {doubt}; look at the overlay{instead}")


def _name(sequence: Sequence, number: int | None) -> str:
    return sequence.name if number is None else f"{sequence.name}, person{number}"
