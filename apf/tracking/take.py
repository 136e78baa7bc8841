"""Track a take: from a session to its tracks, by the stages `initialise` and `track`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from collections.abc import Sequence as Items
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import islice
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from apf.body.kinematics import bone_matrices, posed_joints
from apf.body.limbs import limb_ends
from apf.body.model import BodyModel
from apf.filters.method import Method
from apf.filters.term_weights import list_comparing_weights
from apf.initialisation.automatic import refit_start, walking_factor
from apf.initialisation.from_keypoints import KeypointStart, start_from_keypoints
from apf.initialisation.kept_voxels import LEAST_VOXELS, select_person_points
from apf.initialisation.load import add_load, find_load
from apf.initialisation.personal import Outlines
from apf.initialisation.sequence import initialise
from apf.initialisation.start import Start, StartConfig, StartError, check_startable
from apf.tracking.limb_confidence import LEAST_DISTANCE, SAME_PLACE
from apf.tracking.personal_pass import Complete, fit_personal_body
from apf.tracking.pipeline import TrackingRun, TrackingTask, track_people
from apf.tracking.settings import TakeSettings
from apf.tracking.track import Track
from cl import InputError, UserError
from psfs.common.cones import CONE_FLOATS
from psfs.common.numbers import pick_evenly
from psfs.common.progress import map_in_threads, one_blas_thread
from psfs.people.separation import PersonSession
from psfs.sequence import Sequence
from psfs.session import Session
from psfs.volume import automatic_grid
from psfs.voxels.body_prior import TrackedBody
from psfs.voxels.grid import VoxelGrid

#: Stores the body, its first pose (D,) and a chunk of each seed's track; returns the files, or
#: None.
Keep: TypeAlias = Callable[[BodyModel, np.ndarray, Items[Track]], "Items[Path] | None"]

#: Frames, far apart, in which a start is sought at most: what one frame hides, another one shows.
_TRIES = 3
#: Least rate, frames/s, at which every second frame is enough for that.
_COMPARED_RATE = 20.0
#: Frames of the take to which the body of a start is fitted, and times at most; ratio of costs
#: below which one fits better than another, and mean change of the joints, m, that matters.
_FITTED_FRAMES, _REFITS, _COST_RATIO, _LEAST_CHANGE = 20, 3, 0.97, 0.01
#: Time, s, of a step when walking, over which velocities are measured.
_STEP = 0.5
#: Share by which the qualities of frames differ that are alike: one person's voxels differ so.
_ALIKE = 0.1
#: Largest distance, m, of a given first pose from the volume.
_NEAR = 1.0


@dataclass(frozen=True, eq=False)
class Take:
    """The result for one sequence: `body`, its first `pose` (D,), in frame `frame`, from which it
    was tracked to both ends, and one track for each seed. start: the automatic start; None if body
    and pose were given. seconds: of reconstruction and tracking, without the start. error: the
    error that ended the tracks early. complete: completes the tracks of the person's own body
    after the last pass, see `complete_takes`."""

    sequence: Sequence
    body: BodyModel
    pose: np.ndarray
    start: Start | None
    tracks: list[Track]
    seconds: float
    error: UserError | None = None
    frame: int | None = None
    complete: Complete | None = None


@dataclass(frozen=True, eq=False)
class StartedTake:
    """A take whose body and first pose are known. start: the automatic start, None if they were
    given. personal: whether the body is fitted to the outlines of all frames. others: yields starts
    in other frames. settings: those of the take."""

    session: Session
    task: TrackingTask
    start: Start | None = None
    personal: bool = False
    others: Iterable[Start] = ()
    settings: TakeSettings | None = None


def track_take(
    session: Session,
    settings: TakeSettings | None = None,
    progress: Callable[[str], object] | None = None,
    keep: Keep | None = None,
) -> Take:
    """Find the person in the session's frames and track them.

    The start is sought in the frames in which the person is seen best, see `rank_starts`; from
    there they are tracked to both ends, twice, see `track_again`. In frames that show nobody, the
    track is lost and not `present`.

    progress: called with the name of every stage that begins ("keypoints", "volume", "start",
    "preparing", "fitting"), repeatedly with "start" during the start, and after each frame with
    "tracking" (forward) or "tracking back" (backward); in the second pass with "tracking again" and
    so on. A KeyboardInterrupt during tracking ends the tracks after the last complete frame. keep:
    called about once per second of the first pass with the body, its first pose, and the tracks of
    the frames since its last call; if it stores them, they are not held in memory. Raises
    UserError; an error after the first frame ends the tracks and becomes the take's `error`.
    """
    report = progress or (lambda stage: None)
    started = [start_take(session, settings, progress)]
    started = choose_starts(started, lambda stage: report("start"))
    first = track_first(started, progress, [keep])
    return complete_takes(track_again(started, first, progress))[0]


def start_take(
    session: Session,
    settings: TakeSettings | None = None,
    progress: Callable[[str], object] | None = None,
) -> StartedTake:
    """Find the person's body and first pose, and its rivals, see `choose_starts`."""
    settings = settings or TakeSettings()
    report = progress or (lambda stage: None)
    method, body_and_pose = settings.tracked_method, settings.given
    start: Start | None = None
    frame: int | None = None
    others: Iterable[Start] = ()
    keypoint_fit: KeypointStart | None = None
    is_measured = settings.given is None and not settings.keep_shape
    personal = is_measured and method.uses_voxels and method.goes_back
    if body_and_pose is None:
        check_startable(settings.body_template)  # before anything that takes time
    if settings.keypoints is not None:
        report("keypoints")
        keypoint_fit = fit_to_keypoints(session, settings)
        if body_and_pose is None:
            frame, pose = keypoint_fit.anchored
            body_and_pose = keypoint_fit.body, pose
    if method.uses_voxels:
        check_terms(session.sequence, method)
    if method.uses_voxels or body_and_pose is None:
        check_cameras(session.sequence)
        report("volume")
        automatic_grid(session)
    if body_and_pose is None:
        report("start")
        starts = _seek_starts(session, settings, personal, lambda: report("start"))
        start, others = (next(starts), starts) if personal else (_find_clearest(starts), ())
        body_and_pose, frame = (start.body, start.pose), start.frame
    body, pose = body_and_pose
    if method.uses_voxels and start is None:
        check_first_pose(automatic_grid(session), body, pose, session.sequence.name)
    points = None if keypoint_fit is None else keypoint_fit.observations
    task = TrackingTask(body, pose, method, settings.run_seeds, points, frame)
    return StartedTake(session, task, start, personal, others, settings)


def track_first(
    started: Items[StartedTake],
    progress: Callable[[str], object] | None = None,
    keep: Items[Keep | None] = (None,),
) -> list[Take]:
    """Track the bodies of the starts of one person or several; then all frames together measure
    each person's own body, see `apf.initialisation.personal`. Who has no frame before the tracks
    end early, and who follows, is left out."""
    outlines = [dict[int, Outlines]() for _ in started]
    takes = track_once(started, progress, keep, outlines)
    return [fit_personal(*each, progress) for each in zip(started, takes, outlines, strict=False)]


def track_again(
    started: Items[StartedTake],
    first: Items[Take],
    progress: Callable[[str], object] | None = None,
) -> list[Take]:
    """Return the takes after another pass over them, of everybody with a body of their own from the
    `first` one, and with silhouettes and voxels that expect it where that pass has seen it. As of
    a limb that is lost, nothing is held against what lies beside it. If an interrupt or an error
    ends either pass, the first one counts."""
    personal = [
        (start, take) for start, take in zip(started, first, strict=False)
        if take.body is not start.task.body
    ]  # fmt: skip
    if not personal or any(take.error is not None or take.tracks[0].interrupted for take in first):
        return list(first)
    again = [replace(start, task=_expect_body(start, take)) for start, take in personal]
    report = None if progress is None else lambda stage: progress(f"{stage} again")
    outlines, error = [dict[int, Outlines]() for _ in personal], None
    try:
        seconds = track_once(again, report, (None,) * len(personal), outlines)
        error = seconds[0].error
        if error is None and not seconds[0].tracks[0].interrupted:
            fitted = dict[int, Take]()
            for (start, take), second, silhouettes in zip(personal, seconds, outlines, strict=True):
                second = replace(second, seconds=take.seconds + second.seconds)
                second = fit_personal(start, second, silhouettes, report)
                pairs = zip(take.tracks, second.tracks, strict=True)
                tracks = [compare_passes(*pair) for pair in pairs]
                fitted[id(take)] = replace(second, tracks=tracks)
            return [fitted.get(id(take), take) for take in first]
    except KeyboardInterrupt:
        pass
    except UserError as failure:
        error = failure
    return [
        replace(take, tracks=[each.as_interrupted for each in take.tracks], error=error)
        for take in first
    ]


def _expect_body(started: StartedTake, first: Take) -> TrackingTask:
    """Return the task of the second pass. Where the keypoints lie on the body is estimated again,
    for the person's own."""
    track, session = first.tracks[0], started.session
    tracked = None  # several people's voxels are divided by their bodies, see `place_bodies`
    if not isinstance(session, PersonSession):
        unknown = np.full((len(track), 1, CONE_FLOATS), np.nan)
        cones = np.concatenate([track.known_cones, unknown], 1)
        tracked = TrackedBody(session.sequence.folder, track.frames, cones)
    task, settings = started.task, started.settings
    if settings is not None and settings.keypoints is not None:
        measured = replace(settings, given=(first.body, first.pose))
        task = replace(task, keypoints=fit_to_keypoints(session, measured).observations)
    return replace(task, body=first.body, pose=first.pose, tracked=tracked)


def choose_starts(
    started: Items[StartedTake], progress: Callable[[str], object] | None = None
) -> list[StartedTake]:
    """Return the starts, or in place of one that of its rivals, facing away or in another frame,
    whose body fits best to the whole take: all are tracked through it, see `_try_starts`. Another
    frame is tried for as long as the best one's track is that of no start in another frame. The
    `rival` of a start is then that of the take. Its body, of which what the person carries
    becomes a part, is fitted to frames all over the take, and tracked again, for as long as it fits
    better. Raises UserError and KeyboardInterrupt."""
    chosen, starts, others = list(started), dict[int, list[Start]](), dict[int, Iterator[Start]]()
    for number, take in enumerate(started):
        if take.start is not None and take.personal:
            others[number] = iter(take.others)
            starts[number] = [take.start, *take.start.rivals, *islice(others[number], 1)]
    tried: dict[int, list[_Try]] = {number: [] for number in starts}
    while starts:
        takes = {k: [_begin_with(chosen[k], each) for each in some] for k, some in starts.items()}
        for number, tries in _try_starts(takes, progress).items():
            tried[number] += tries
        doubtful = (number for number, tries in tried.items() if not _is_confirmed(tries))
        starts = {k: more for k in doubtful if (more := [*islice(others[k], 1)])}
    best = {number: _choose(tries) for number, tries in tried.items()}
    better = best
    for _ in range(_REFITS):
        fitted = {number: _refit(each, progress) for number, each in better.items()}
        tries = _try_starts({k: takes for k, takes in fitted.items() if takes}, progress)
        refitted = {number: reduce(_prefer, each) for number, each in tries.items()}
        better = {k: each for k, each in refitted.items() if _prefer(best[k], each) is each}
        best |= better
    for number, each in best.items():
        chosen[number] = each.take
    return chosen


class _Try(NamedTuple):
    """A start, its track through the take, and the cost of that, by which starts are compared."""

    take: StartedTake
    track: Track
    cost: float

    @property
    def first_frame(self) -> int:
        """The first of the frames in which the start was sought."""
        assert self.take.start is not None
        return self.take.start.frames[0]


def _begin_with(take: StartedTake, start: Start) -> StartedTake:
    task = replace(take.task, body=start.body, pose=start.pose, frame=start.frame)
    return replace(take, task=task, start=start, others=())


def _try_starts(
    starts: Mapping[int, Items[StartedTake]], progress: Callable[[str], object] | None
) -> dict[int, list[_Try]]:
    """Track the bodies of each person's starts through the take in one direction, all together, in
    every second frame unless these are few a second. Each person has one start or more."""
    runs = list[TrackingRun]()
    for takes in starts.values():
        session = takes[0].session  # of all, which share the person's voxels
        frames, step = session.frames, 2 if session.rate >= _COMPARED_RATE else 1
        coarse = session.with_frames(frames[-frames.start % step :: step] or frames)
        for task in (take.task for take in takes):
            method, seeds = task.method.replace(both_ways=False), task.seeds[:1]
            runs.append(TrackingRun(coarse, replace(task, method=method, seeds=seeds)))
    tracked = iter(track_people(runs, progress) if runs else ())

    def judge(take: StartedTake) -> _Try:
        result = next(tracked, None)
        if result is not None and result.error is not None:
            raise result.error
        if result is None or result.tracks[0].interrupted:
            raise KeyboardInterrupt
        track = result.tracks[0]
        walking = walking_factor(take.task.body, track.poses, _measure_velocities(track))
        error, misfit = -track.diagnostics["best_log_weight"], track.diagnostics["misfit"]
        return _Try(take, track, float(error.mean() * misfit.mean()) * walking)

    return {number: [judge(take) for take in takes] for number, takes in starts.items()}


def _measure_velocities(track: Track) -> np.ndarray:
    """Return the horizontal velocities (F, 2), m/s, of the root, each over a step; 0 where it is
    lost."""
    roots, times = bone_matrices(track.its_body, track.poses)[1][:, 0, :2], track.times
    before = np.searchsorted(times, times - _STEP / 2)
    after = np.searchsorted(times, times + _STEP / 2, side="right") - 1
    seconds = np.maximum(times[after] - times[before], 1 / track.fps)
    return (roots[after] - roots[before]) / seconds[:, None] * ~track.lost[:, None]


def _choose(tries: Items[_Try]) -> _Try:
    """Return the try that costs least; its start's rival is the best one with another track."""
    best = min(tries, key=lambda each: each.cost)
    others = [each.cost for each in tries if not _is_same(each.track, best.track)]
    assert best.take.start is not None
    start = replace(best.take.start, rival=min(others, default=np.inf) / best.cost, rivals=())
    return best._replace(take=replace(best.take, start=start))


def _is_confirmed(tries: Items[_Try]) -> bool:
    """Return whether a start in other frames leads to the track that costs least."""
    best = min(tries, key=lambda each: each.cost)
    return any(
        each.first_frame != best.first_frame and _is_same(each.track, best.track) for each in tries
    )


def _is_same(one: Track, other: Track) -> bool:
    """Return whether the joints of two tracks are in the same places on average."""
    return float(np.linalg.norm(one.joints - other.joints, axis=-1).mean()) <= SAME_PLACE


def _prefer(one: _Try, other: _Try) -> _Try:
    """Return the first try unless the other one clearly costs less."""
    return other if other.cost < _COST_RATIO * one.cost else one


def _refit(tried: _Try, progress: Callable[[str], object] | None) -> list[StartedTake]:
    """Return a start whose body is fitted to frames all over the take, from its track on, and has
    what the person carries as a part; none if that body is nearly the same. If the load was not
    known, the arms were tracked where it is; then the first one is a start that is sought anew."""
    take, track = tried.take, tried.track
    start, settings = take.start, take.settings
    assert start is not None and settings is not None
    rows = np.flatnonzero(~track.lost)
    rows = rows[pick_evenly(len(rows), _FITTED_FRAMES)]
    frames, poses = track.frames[rows].tolist(), track.poses[rows]
    clouds = list(take.session.iterate_clouds(automatic_grid(take.session), frames))
    report = (lambda: None) if progress is None else partial(progress, "start")
    report()
    template, errors = start.template, -track.diagnostics["best_log_weight"][rows, -1]
    load = find_load(start.body, poses, clouds) if template is template.without_load else []
    if load:
        template = add_load(template, load, start.height)
    fitted = refit_start(template, start, poses, frames, clouds, errors, settings.height)
    before, after = (posed_joints(body, fitted.poses) for body in (start.body, fitted.body))
    starts = list[Start]()
    if load or np.linalg.norm(after - before, axis=-1).mean() > _LEAST_CHANGE:
        starts.append(fitted)
    if load:
        with suppress(StartError):
            fresh = _start_in(
                take.session, template, settings, start.frames[0], report, with_rival=False
            )
            starts.insert(0, replace(fresh, rival=start.rival, rivals=()))
    return [_begin_with(take, each) for each in starts]


def track_once(
    started: Items[StartedTake],
    progress: Callable[[str], object] | None,
    keep: Items[Keep | None],
    outlines: Items[dict[int, Outlines]],
) -> list[Take]:
    """Track the bodies of some starts through the take in one pass. outlines: receive those of the
    frames' silhouettes, by their numbers, if they are needed."""
    report = progress or (lambda stage: None)
    report("preparing")
    began = time.perf_counter()
    runs = [
        TrackingRun(
            start.session, start.task,
            None if store is None else partial(store, start.task.body, start.task.pose),
            silhouettes if start.personal else None,
        )
        for start, store, silhouettes in zip(started, keep, outlines, strict=True)
    ]  # fmt: skip
    everybody = track_people(runs, report)
    seconds = time.perf_counter() - began
    return [
        Take(
            start.session.sequence, start.task.body, start.task.pose, start.start, tracked.tracks,
            seconds, tracked.error, start.task.frame,
        )
        for start, tracked in zip(started, everybody, strict=False)
    ]  # fmt: skip


def fit_personal(
    started: StartedTake,
    take: Take,
    outlines: Mapping[int, Outlines],
    progress: Callable[[str], object] | None = None,
) -> Take:
    """Return the take with the person's own body, which is measured from the body of the start."""
    if not (started.personal and outlines):
        return take
    if progress is not None:
        progress("fitting")
    began, template = time.perf_counter(), started.task.body
    with one_blas_thread():  # the products are small
        tracks, complete = fit_personal_body(take.tracks, template, outlines, started.session.rate)
    pose = tracks[0].poses[list(tracks[0].frames).index(take.frame)]
    seconds = take.seconds + time.perf_counter() - began
    return replace(
        take, body=tracks[0].its_body, pose=pose, tracks=tracks, seconds=seconds, complete=complete
    )


def complete_takes(takes: Items[Take]) -> list[Take]:
    """Return the takes whose tracks have what only the last pass needs: the uncertainty and the
    surface of the person's own body, if there is one. If an interrupt comes first, they count as
    interrupted."""

    def complete(take: Take) -> Take:
        if take.complete is None:
            return take
        began = time.perf_counter()
        tracks = take.complete(take.tracks)
        return replace(take, tracks=tracks, seconds=take.seconds + time.perf_counter() - began)

    try:
        with one_blas_thread():  # which all threads share
            return list(map_in_threads(complete, takes))
    except KeyboardInterrupt:
        return [
            replace(take, tracks=[track.as_interrupted for track in take.tracks])
            if take.complete else take
            for take in takes
        ]  # fmt: skip


def compare_passes(first: Track, second: Track) -> Track:
    """Return the second of two tracks of the same frames with the disagreement of the passes of
    both: a body that is expected somewhere agrees too easily there."""
    passes = "limb_disagreement"
    if passes not in first.diagnostics or passes not in second.diagnostics:
        return second
    ends = limb_ends(second.its_body)
    moved = np.linalg.norm(first.joints[:, ends] - second.joints[:, ends], axis=-1)
    before = np.maximum(np.maximum(first.diagnostics[passes], moved), LEAST_DISTANCE)
    after = np.maximum(second.diagnostics[passes], LEAST_DISTANCE)
    stated = {k: values for k, values in second.diagnostics.items() if k != "limb_confidence"}
    joined = np.where(np.isnan(before), after, np.sqrt(before * after))
    return replace(second, diagnostics={**stated, passes: joined}).judged


def _seek_starts(
    session: Session, settings: TakeSettings, compared: bool, progress: Callable[[], object]
) -> Iterator[Start]:
    """Yield starts, sought from the likeliest frames on. If they are `compared` afterwards, the
    first one alone has a rival. Raises StartError if there is none."""
    n_found, failed = 0, None
    for frame in rank_starts(session, progress):
        with_rival = n_found == 0 or not compared
        try:
            start = _start_in(
                session, settings.body_template, settings, frame, progress, with_rival
            )
        except StartError as error:
            failed = failed or error
            continue
        n_found += 1
        yield start
    if n_found == 0:
        raise failed or StartError("no start was tried; expected frames with a person")


def _find_clearest(starts: Iterable[Start]) -> Start:
    """Return the first start whose heading is not ambiguous, else the least ambiguous one."""
    sought = list[Start]()
    for start in starts:
        sought.append(start)
        if not start.is_ambiguous:
            break
    return max(sought, key=lambda start: start.rival)


def _start_in(
    session: Session,
    template: BodyModel,
    settings: TakeSettings,
    frame: int,
    progress: Callable[[], object],
    with_rival: bool = True,
) -> Start:
    """Return the start from `frame` on, see `find_start`. Raises StartError."""
    return initialise(
        session.with_frames(session.frames[session.frames.index(frame) :]), template,
        height=settings.height, keep_shape=settings.keep_shape, with_rival=with_rival,
        seed=settings.tracked_method.filter.search.seed, progress=progress,
    )  # fmt: skip


def rank_starts(session: Session, progress: Callable[[], object] | None = None) -> list[int]:
    """Return the frames in which to seek a start, the likeliest first.

    Of frames spread over the session, those are ranked in which the person is seen best for as long
    as a start takes: whole, upright, and in the pictures of many cameras. About equal ones
    are spread over the take, the earliest first. Raises StartError if none of them shows anybody.
    """
    config, frames = StartConfig(), session.frames
    picked = np.array([frames[int(k)] for k in pick_evenly(len(frames))])
    grid = automatic_grid(session)
    views = np.zeros((len(picked), 3))  # voxels, height, cameras that see them
    with suppress(InputError):
        for row, cloud in enumerate(session.iterate_clouds(grid, picked.tolist())):
            points = select_person_points(grid, cloud.indices)
            if len(points) >= LEAST_VOXELS:
                inside = sum(camera.look_up(points)[0].mean() for camera in session.rig)
                views[row] = len(points), np.ptp(points[:, 2]), inside
            if progress is not None:
                progress()
    visible = views[:, 0] > 0
    if not visible.any():
        raise StartError(
            f"nobody is seen in {len(picked)} frames spread over the take: fewer than "
            f"{LEAST_VOXELS} surface voxels in each; expected a person in view of all cameras "
            f"for a second{', in the stated --volume' if session.sequence.volume else ''}"
        )
    quality = np.minimum(views / np.quantile(views[visible], 0.75, axis=0), 1).prod(1)
    lasting = config.duration * session.sequence.fps
    later = np.abs(picked - picked[:, None])
    within = np.triu(later <= lasting)
    during = (within * quality).sum(1) / within.sum(1) * visible
    if (whole := visible & (later[:, -1] >= lasting)).any():
        during *= whole  # a start before the take's end has fewer frames
    alike = np.flatnonzero(during >= (1 - _ALIKE) * during.max())
    spread = alike[pick_evenly(len(alike), _TRIES)]
    rest = [row for row in np.argsort(-during) if during[row] > 0 and row not in alike]
    return [int(picked[row]) for row in [*spread, *rest]][:_TRIES]


def check_terms(sequence: Sequence, method: Method) -> None:
    """Raise InputError if all terms of the likelihood need pictures and there are only masks."""
    weights = method.filter.settings
    if sequence.has_images or any(weights[name] for name in list_comparing_weights(pictures=False)):
        return
    terms = [term for name, term in list_comparing_weights().items() if weights[name]]
    raise InputError(
        f"{sequence.name}: has masks, and no pictures for the terms {', '.join(terms)}; expected "
        "pictures, or other terms, too"
    )


def check_first_pose(grid: VoxelGrid, body: BodyModel, pose: np.ndarray, name: str) -> None:
    """Raise InputError if no joint of a given first pose (D,) lies in the volume or near it."""
    joints = posed_joints(body, pose[None])[0]
    beyond = np.maximum(np.maximum(grid.low - joints, joints - grid.high), 0)
    if np.linalg.norm(beyond, axis=-1).min() <= _NEAR:
        return
    place, low, high = (
        ", ".join(f"{value:.2f}" for value in point)
        for point in (joints.mean(0), grid.low, grid.high)
    )
    raise InputError(
        f"{name}: the first pose (--init) is at ({place}) m, beyond the volume from ({low}) to "
        f"({high}) m; expected the person's place in the first frame, in metres with Z up"
    )


def check_cameras(sequence: Sequence) -> None:
    """Raise InputError if the sequence has only one camera: its voxels would have no depth."""
    if len(sequence.rig) < 2:
        raise InputError(
            f"{sequence.name}: one camera, {sequence.rig.names[0]}; expected two or more, which "
            "see the person from different sides at the same time"
        )


def fit_to_keypoints(session: Session, settings: TakeSettings) -> KeypointStart:
    """Return the fit to the keypoints of the selected frames, which the settings must have. A given
    body keeps its shape, and only its poses and the positions of the keypoints on it are fitted."""
    assert settings.keypoints is not None
    stated = settings.given
    return start_from_keypoints(
        session.rig, settings.keypoints, settings.body_template if stated is None else stated[0],
        session.frames,
        height=settings.height, keep_shape=settings.keep_shape or stated is not None,
    )  # fmt: skip
