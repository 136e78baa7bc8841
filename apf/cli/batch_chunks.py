"""A long take on several workers: its start, the overlapping chunks into which it is cut, and the
joining of their tracks."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from apf.body.toml import load_body, save_body
from apf.cli.batch_take import TakeDone, TakeJob, process_take, write_take
from apf.cluster.processes import Pool, Task
from apf.cluster.task_side import TaskProgress, log_to
from apf.cluster.workers import select_worker_device
from apf.formats.pose import read_pose, write_pose
from apf.report.summary import read_summary
from apf.request import TrackRequest
from apf.takes.job import TrackJob
from apf.takes.results import FinishedTake, finish_take, write_tracks
from apf.takes.start import find_first_pose, read_given_start
from apf.tracking.take import Take
from apf.tracking.track import Track, concatenate_tracks
from apf.tracking.two_way import OVERLAP
from cl import Device, InputError, NumpyDevice
from psfs.common.numbers import json_number
from psfs.diagnostics.examination import Examination
from psfs.opening import examine_footage, open_sequence, open_session, select_common_frames
from psfs.session import Session
from psfs.volume import automatic_grid, find_volume


@dataclass(frozen=True)
class Seam:
    """The join of two chunks.

    frame: first frame of the later chunk. distance: mean distance of the joints there, m; infinite
    if the chunks share no frame in which neither is lost.
    """

    frame: int
    distance: float


def cut_chunks(frames: range, n_frames: int, overlap: int) -> list[range]:
    """Return the frames of each chunk: about `n_frames`, and `overlap` frames of the next chunk."""
    n_parts = max(1, round(len(frames) / n_frames))
    edges = np.linspace(0, len(frames), n_parts + 1).round().astype(int).tolist()
    if n_parts > 1 and min(np.diff(edges)) <= overlap:
        return [frames]
    return [frames[a : min(b + overlap, len(frames))] for a, b in pairwise(edges)]


def find_seam(first: Track, second: Track) -> Seam:
    """Find the frame of the overlap in which two tracks agree best."""
    shared, of_first, of_second = np.intersect1d(first.frames, second.frames, return_indices=True)
    if not shared.size:
        return Seam(int(second.frames[0]), np.inf)
    apart = np.linalg.norm(first.joints[of_first] - second.joints[of_second], axis=-1).mean(1)
    apart[first.lost[of_first] | second.lost[of_second]] = np.inf
    best = int(np.argmin(apart))
    return Seam(int(shared[best]), float(apart[best]))


def join_tracks(tracks: Sequence[Track]) -> tuple[Track, list[Seam]]:
    """Join the tracks of consecutive chunks; return the track and its seams.

    Its provenance is that of the first, with the seams under `parts`.
    """
    seams = [find_seam(a, b) for a, b in pairwise(tracks)]
    begins = [-np.inf, *(s.frame for s in seams)]
    ends = [*(s.frame for s in seams), np.inf]
    parts = [
        track.select((track.frames >= begin) & (track.frames < end))
        for track, begin, end in zip(tracks, begins, ends, strict=True)
    ]
    provenance = json.loads(tracks[0].provenance)
    provenance["parts"] = [
        {"frame": s.frame, "apart_mm": json_number(1000 * s.distance, 1)} for s in seams
    ]
    whole = replace(concatenate_tracks(parts), provenance=json.dumps(provenance))
    return whole, seams


#: The folder in OUT for takes that are tracked in chunks.
PARTS = "parts"
#: The file of a take's first pose, in its folder there.
START = "start.txt"
#: Mean distance over the joints up to which two tracks of a frame are the same but for noise, m:
#: runs with different seeds lie 10 to 20 mm apart, a wrong start 100 and more.
_AGREEMENT = 0.05


def track_take(pool: Pool, job: TakeJob) -> TakeDone:
    """Have workers track a take as one task, or, if it is long enough to be cut, its start, its
    chunks, and the joining of these."""
    last = Task(job.name, process_take, (job,))
    if job.part_frames is not None:
        chunks = pool.run(Task(f"{job.name}/start", cut_take, (job, job.part_frames)))
        if chunks:
            pool.run_all([Task(chunk.name, process_take, (chunk,)) for chunk in chunks])
            last = Task(f"{job.name}/joining", join_chunks, (job, chunks))
    done: TakeDone = pool.run(last)
    return done


def cut_take(progress: TaskProgress, job: TakeJob, part_frames: int) -> tuple[TakeJob, ...]:
    """Find the person in a take and return the jobs of its chunks, which share body, volume and
    cameras. Return no jobs if the take is too short to be cut."""
    with log_to(job.log, f"{job.name}: cutting {job.source}"):
        progress.begin("opening")
        request = job.request
        if request.seeds is not None:
            raise InputError("--seeds and --part-frames; expected one of them")
        device = select_worker_device(request.device)
        examination, request, _ = _examine(request, device, progress)
        session = examination.session
        frames = select_common_frames(request.frames, session.sequence, progress.warn)
        chunks = cut_chunks(frames, part_frames, OVERLAP)
        if len(chunks) < 2:
            print(f"{len(frames)} frames are too few for parts of {part_frames} that overlap")
            return ()
        folder = job.out.parent / PARTS / job.name
        shared = _share_start(progress, request, session, folder)
        return tuple(
            replace(
                job,
                name=f"{job.name}/part{number}",
                request=shared.replace(
                    output=folder / f"part{number}",
                    init=folder / START if number == 0 else None,
                    frames=slice(chunk.start, chunk.stop, chunk.step),
                ),
                part_frames=None,
                exports=(),
            )
            for number, chunk in enumerate(chunks)
        )


def _examine(
    request: TrackRequest, device: Device | NumpyDevice, progress: TaskProgress
) -> tuple[Examination, TrackRequest, list[str]]:
    """Open the footage of a request and examine it, see `examine_footage`."""
    session = open_session(request, open_sequence(request), device)
    return examine_footage(request, session, progress.warn, person=True)


def _share_start(
    progress: TaskProgress, request: TrackRequest, session: Session, folder: Path
) -> TrackRequest:
    """Find the person and return the request that all chunks of the take share. The body and first
    pose are written into `folder`."""
    volume, grid, sequence = find_volume(session), automatic_grid(session), session.sequence
    first = session.frames[0]
    given = read_given_start(sequence.folder, first, request.body, request.init, request.convention)
    if given is None:
        given = find_first_pose(session, request, lambda: progress("start"), progress.warn)
    save_body(folder / "body.toml", given[0])
    write_pose(folder / START, given[1], given[0])
    box = [np.asarray(corner).tolist() for corner in (volume.low, volume.high)]
    return request.replace(
        body=str(folder / "body.toml"),
        capture=request.capture.replace(volume=box, cameras=tuple(sequence.rig.names)),
        voxel_size=grid.voxel_size,
        video=False,
        report=False,
    )


def join_chunks(progress: TaskProgress, job: TakeJob, chunks: Sequence[TakeJob]) -> TakeDone:
    """Write the take from its chunks.

    A chunk that agrees with the chunk before it in no common frame is tracked again, from the last
    pose of that chunk in a common frame.
    """
    with log_to(job.log, f"{job.name}: joining {len(chunks)} parts"):
        tracks = [Track.open(chunks[0].out)]
        for chunk in chunks[1:]:
            track = Track.open(chunk.out)
            if find_seam(tracks[-1], track).distance > _AGREEMENT:
                print(f"{chunk.name}: does not agree with the part before; tracked again")
                frames = chunk.request.frames
                assert frames is not None
                before, pose = tracks[-1], chunk.out.parent / f"{chunk.out.name}.txt"
                row = before.frames.tolist().index(frames.start)
                write_pose(pose, before.poses[row], before.its_body)
                process_take(progress, replace(chunk, request=chunk.request.replace(init=pose)))
                track = Track.open(chunk.out)
            tracks.append(track)
        whole, seams = join_tracks(tracks)
        apart = ", ".join(f"{json_number(1000 * s.distance, 1)} at {s.frame}" for s in seams)
        print(f"parts are joined with mm between them: {apart}")

        def write(request: TrackRequest, device: Device | NumpyDevice) -> list[FinishedTake]:
            examination, request, remarks = _examine(request, device, progress)
            body = load_body(str(chunks[0].out.parent / "body.toml"))
            pose = read_pose(chunks[0].out.parent / START, body)
            sequence = examination.session.sequence
            seconds = sum(float(read_summary(chunk.out)["seconds"]) for chunk in chunks)
            take = Take(sequence, body, pose, None, [whole], seconds)
            progress.n_frames = len(whole)
            track_job = TrackJob(request, device, progress, tuple(remarks))
            write_tracks(track_job, take)
            judgements = finish_take(track_job, examination, take)
            return [FinishedTake(take, len(whole), request.output, judgements)]

        done = write_take(progress, job, write, parts=apart)
        shutil.rmtree(chunks[0].out.parent, ignore_errors=True)
        return done
