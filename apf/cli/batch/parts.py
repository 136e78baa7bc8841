"""A long take on several workers: its start, its parts, and their tracks joined to one."""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from apf.api import given_start, template_of
from apf.body import load_body, save_body
from apf.cli.batch.take import TakeDone, TakeJob, do_take, written_take
from apf.cli.first_pose import naming_init, warn_of_doubts
from apf.cli.method_flags import chosen_method
from apf.cli.track import finish_take, write_files, write_track_settings
from apf.cluster.config import ChunksConfig
from apf.cluster.courses import Workflow
from apf.cluster.parts import cut_chunks, find_seam, join_tracks, to_millimetres
from apf.cluster.pool import Task
from apf.cluster.task_side import TaskProgress, log_to
from apf.cluster.workers import select_worker_device
from apf.formats.pose import read_pose, write_pose
from apf.initialisation import start_of
from apf.tracking.batch import Take
from apf.tracking.track import Track
from cl import InputError
from psfs.cli.sequence_flags import open_trusted, selected_frames
from psfs.volume import automatic_grid, foreground_box

#: Folder in OUT of takes that are being tracked in parts.
PARTS = "parts"
#: The first pose of a take, in its folder there.
START = "start.txt"


def course_of(job: TakeJob) -> Workflow:
    """Return the tasks of a take, one after the other: itself; or, where it is to be cut and long
    enough, its start, its parts, and how they are joined."""
    if job.part_frames is not None:
        (parts,) = yield [Task(f"{job.name}/start", cut_take, (job, job.part_frames))]
        if parts:
            yield [Task(part.name, do_take, (part,)) for part in parts]
            (done,) = yield [Task(f"{job.name}/joining", join_parts, (job, parts))]
            return done
    (done,) = yield [Task(job.name, do_take, (job,))]
    return done


def cut_take(progress: TaskProgress, job: TakeJob, part_frames: int) -> tuple[TakeJob, ...]:
    """Find the person in a take and return the jobs of its parts, which share body, volume and
    cameras; none of a take too short to be cut."""
    with log_to(job.log, f"{job.name}: cutting {job.source}"):
        progress.begin("opening")
        args = job.arguments()
        args.folder = str(job.source)
        if args.seeds is not None:
            raise InputError("--seeds and --part-frames; expected one of them")
        device = select_worker_device(args.device)
        sequence, _ = open_trusted(args, device, person=True)
        frames = selected_frames(args, sequence)
        overlap = round(ChunksConfig().overlap * sequence.fps / abs(frames.step))
        parts = cut_chunks(frames, part_frames, overlap)
        if len(parts) < 2:
            print(f"{len(frames)} frames are too few for parts of {part_frames} that overlap")
            return ()
        selection = slice(frames.start, frames.stop, frames.step)
        config = args.configs.get("reconstruction")
        volume = sequence.volume or foreground_box(sequence, selection, config, device)
        grid = automatic_grid(sequence, selection, args.voxel_size, config, device)
        given = given_start(sequence.folder, frames[0], args.body, args.init, args.convention)
        if given is None:
            template, own_shape = template_of(args.body)
            seed = chosen_method(args).filter.search.seed
            with naming_init(sequence):
                start = start_of(
                    device, sequence, grid, template, selection, config, height=args.height,
                    keep_shape=own_shape, seed=seed, progress=lambda: progress("start"),
                )  # fmt: skip
            warn_of_doubts(sequence, start)
            given = start.body, start.pose
        folder = job.out.parent / PARTS / job.name
        save_body(folder / "body.toml", given[0])
        write_pose(folder / START, given[1], given[0])
        box = ",".join(repr(float(x)) for x in np.ravel(np.transpose(volume)))
        shared = (
            *(word for word in job.words if not word.startswith("--init=")),
            f"--body={folder / 'body.toml'}",
            f"--volume={box}",
            f"--voxel-size={grid.voxel_size!r}",
            f"--cameras={','.join(sequence.rig.names)}",
            "--no-overlay",
            "--no-report",
        )
        return tuple(
            replace(
                job,
                name=f"{job.name}/part{number}",
                out=folder / f"part{number}",
                words=(*shared, *([f"--init={folder / START}"] * (number == 0)), _frames(part)),
                part_frames=None,
                exports=(),
            )
            for number, part in enumerate(parts)
        )


def _frames(frames: range) -> str:
    return f"--frames={frames.start}:{frames.stop}:{frames.step}"


def join_parts(progress: TaskProgress, job: TakeJob, parts: Sequence[TakeJob]) -> TakeDone:
    """Write the take out of its parts. One that does not agree with the part before it anywhere is
    tracked again, from that one's last pose that both have."""
    with log_to(job.log, f"{job.name}: joining {len(parts)} parts"):
        tracks = [Track.open(parts[0].out)]
        for part in parts[1:]:
            track = Track.open(part.out)
            if find_seam(tracks[-1], track).distance > ChunksConfig().agreement:
                print(f"{part.name}: does not agree with the part before; tracked again")
                track = _tracked_on(progress, part, tracks[-1])
            tracks.append(track)
        whole, seams = join_tracks(tracks)
        apart = ", ".join(f"{to_millimetres(s.distance)} at {s.frame}" for s in seams)
        print(f"parts are joined with mm between them: {apart}")

        def write(args: argparse.Namespace, device: Any) -> Take:
            args.folder = str(job.source)
            sequence, left_out = open_trusted(args, device, person=True)
            body = load_body(str(parts[0].out.parent / "body.toml"))
            pose = read_pose(parts[0].out.parent / START, body)
            take = Take(sequence, body, pose, None, [whole], 1.0)
            write_pose(args.output / START, pose, body)
            write_files(args.output, whole, body)
            write_track_settings(args, chosen_method(args))
            progress.n_frames = len(whole)
            finish_take(args, device, take, left_out, [0], progress)
            return take

        done = written_take(progress, job, write, parts=apart)
        shutil.rmtree(parts[0].out.parent, ignore_errors=True)
        return done


def _tracked_on(progress: TaskProgress, part: TakeJob, before: Track) -> Track:
    """A part's track from the pose that the part before it has in its first frame."""
    first = part.arguments().frames.start
    rows = np.flatnonzero(before.frames == first)
    pose = part.out.parent / f"{part.out.name}.txt"
    write_pose(pose, before.poses[rows[0]], before.its_body)
    again = replace(part, words=(*part.words, f"--init={pose}"))
    do_take(progress, again)
    return Track.open(again.out)
