"""`apf live`: track a person live, from cameras or a recording played at its own rate."""

from __future__ import annotations

import argparse
import webbrowser
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from apf.api import read_given_start
from apf.backend import check_renderer
from apf.body.model import BodyModel
from apf.cli.first_pose import check_start, find_first_pose
from apf.cli.method_flags import METHOD_FLAGS, select_method
from apf.cli.track import RESULTS, write_files
from apf.evaluation.evaluate import load_truth
from apf.filters.method import Method
from apf.formats.trc import JointSeries
from apf.live.budget import list_sizes
from apf.live.captures import box_around, open_cameras
from apf.live.config import LiveConfig
from apf.live.error import live_errors
from apf.live.pace import Pace, PaceReporter
from apf.live.pictures import fitting_factor
from apf.live.session import Live, LiveResult, LiveStart
from apf.live.sources import Replay, Source
from apf.tracking.pipeline import build_track
from apf.tracking.track import Track
from cl import Device, InputError, select_device
from psfs.cli.commandline import stderr, stdout, warn
from psfs.cli.sequence_flags import (
    collect_overrides,
    open_sequence,
    select_common_frames,
)
from psfs.cli.settings import refuse_unused, write_settings
from psfs.common.files import write_json
from psfs.common.outputs import output_folder
from psfs.session import Session, SessionSettings
from psfs.volume import automatic_grid
from psfs.voxels.grid import VoxelGrid
from psfs.voxels.occupied_box import default_voxel_size


def run(args: argparse.Namespace) -> None:
    check_start(args)
    _check_ranges(args)
    method = select_method(args)
    # The frames are not evenly spaced, and `Live` predicts the motion itself.
    config = args.configs.get("live") or LiveConfig()
    noise = method.filter.search.noise
    if method.uses_voxels and args.noise is None and "method" not in args.configs:
        noise = config.noise
    method = method.replace(filter=method.filter.with_changes(velocity=0.0, noise=noise))
    device = select_device(args.device)
    if not isinstance(device, Device):
        raise InputError("--device numpy is no device for live tracking; expected an OpenCL device")
    check_renderer(device, method)
    truth = load_truth(args.truth, args.convention) if args.truth else None
    stated = [Path(path) for path in (args.init, args.body, args.truth) if path is not None]
    inputs = [Path(args.folder), *(path for path in stated if path.exists())]
    with output_folder(args.output, args.parser.prog, inputs, RESULTS):
        _live(args, method, config, device, truth)


def _live(
    args: argparse.Namespace,
    method: Method,
    config: LiveConfig,
    device: Device,
    truth: JointSeries | None,
) -> None:
    source, start = _captures(args, method) if args.captures else _replay(args, method, device)
    grid, body = start.grid, start.body
    sized_by_hand = args.n_particles is not None or args.n_layers is not None
    searches = (
        [method] if sized_by_hand and args.budget is None else list_sizes(method, config.sizes)
    )
    follow = bool(args.captures) and args.volume is None
    scale = args.scale
    if scale is None:
        scale = 1.0 if device.is_gpu or grid is None else fitting_factor(source.rig, grid)
    live = Live(
        device,
        source,
        start,
        searches,
        budget=args.budget,
        follow=follow,
        scale=scale,
        config=config,
    )
    pace = Pace(
        live.expected_rate,
        args.budget or source.fps,
        live.processing_time,
        float(live.governor.costs[live.governor.chosen]),
        scale,
    )
    if pace.keeps_up:
        stderr.print(str(pace), soft_wrap=True)
    else:
        warn(f"{pace}; {pace.advice}")
    result = _run(args, live, start, pace)
    if not result.frames:
        raise InputError("no frame was tracked; expected at least one before the end")
    track = _track(body, source, result, {**method.describe(), "device": device.name})
    write_files(args.output, track, body)
    write_settings(args.output, args, {"method": method, "live": config}, METHOD_FLAGS)
    summary = live.timeline.summary() | {"sizes": result.sizes, "scale": scale}
    summary["lost"] = int(track.lost.sum())
    if truth is not None:
        summary |= live_errors(track, truth, np.array(result.latencies))
    write_json(args.output / "live.json", summary)
    live.timeline.plot(args.output / "timeline.png")
    _print_summary(summary, args.output)


def _run(args: argparse.Namespace, live: Live, start: LiveStart, pace: Pace) -> LiveResult:
    """Run, with its progress on the terminal and, with --studio, on a page."""
    late = warn if pace.keeps_up else None
    with ExitStack() as stack:
        if stderr.console.is_terminal:
            waiting = stderr.console.status("waiting for the first frame; Ctrl-C ends")
            progress = PaceReporter(pace.wanted, stack.enter_context(waiting).update, None, late)
        else:
            progress = PaceReporter(pace.wanted, None, partial(stderr.print, soft_wrap=True), late)
        if not args.studio:
            return live.run(progress)
        from apf.studio.live import LivePage  # imports an extra

        rig = live.source.rig
        page = stack.enter_context(
            closing(LivePage(start.body, start.pose, rig, start.grid, live.stop))
        )
        stdout.print(f"{page.address} (for this machine alone)", soft_wrap=True)
        webbrowser.open(page.address)
        both = (progress, page)
        return live.run(lambda result, timeline: [of(result, timeline) for of in both])


def _check_ranges(args: argparse.Namespace) -> None:
    if args.scale is not None and not 0.05 <= args.scale <= 1:
        raise InputError(f"--scale is {args.scale}; expected 0.05 to 1")
    if args.captures:
        refuse_unused(
            args, ["frames"], "applies only to a recording; expected none with --captures"
        )
    else:
        refuse_unused(args, ["empty"], "applies only to --captures; expected them with it")
    if args.budget is not None and not 0.1 <= args.budget <= 1000:
        raise InputError(f"--fps is {args.budget}; expected 0.1 to 1000 poses per second")
    if not 0 <= args.empty <= 600:
        raise InputError(f"--empty is {args.empty}; expected 0 to 600 s")


def _replay(args: argparse.Namespace, method: Method, device: Device) -> tuple[Source, LiveStart]:
    """Return a recorded sequence, its grid if voxels are needed, body and first pose."""
    sequence = open_sequence(args)
    frames = select_common_frames(args, sequence)
    settings = SessionSettings(selection=args.frames or slice(None), voxel_size=args.voxel_size)
    session = Session(sequence, device, settings)
    given = read_given_start(sequence.folder, frames[0], args.body, args.init, args.convention)
    grid = None
    if method.uses_voxels or given is None:
        grid = automatic_grid(session)
    if given is None:
        given = find_first_pose(session, args, method.filter.search.seed, None)
    return Replay(sequence, frames), LiveStart(grid, *given)


def _captures(args: argparse.Namespace, method: Method) -> tuple[Source, LiveStart]:
    """Return cameras, the grid of --volume or one around the first pose if voxels are needed, body
    and first pose."""
    start = read_given_start(Path(args.folder), 0, args.body, args.init, args.convention)
    if start is None:
        raise InputError("cameras have no first pose; expected --init with a pose file or joints")
    source = open_cameras(Path(args.folder), collect_overrides(args), args.captures, args.empty)
    grid = None
    if method.uses_voxels:
        low, high = np.array(args.volume) if args.volume else box_around(*start)
        size = args.voxel_size or default_voxel_size(source.rig, low, high)
        grid = VoxelGrid.covering(low, high, size)
    return source, LiveStart(grid, *start)


def _track(
    body: BodyModel, source: Source, result: LiveResult, provenance: dict[str, Any]
) -> Track:
    """Return the track of the results. The searches differ in their numbers of layers: missing
    layers are NaN."""
    most = max(len(estimate.ess) for estimate in result.estimates)

    def padded(values: np.ndarray) -> np.ndarray:
        return np.pad(values, (0, most - len(values)), constant_values=np.nan)

    estimates = [
        replace(e, ess=padded(e.ess), beta=padded(e.beta), least_error=padded(e.least_error))
        for e in result.estimates
    ]
    return build_track(body, source.fps, result.frames, estimates, provenance).judged


def _print_summary(summary: dict[str, Any], folder: Path) -> None:
    """Print the figures of a run to standard output."""
    latency = summary["latency_ms"]
    dropped = ", ".join(f"{count} before {stage}" for stage, count in summary["dropped"].items())
    stdout.print(f"{summary['results']} poses, {summary['fps']} per second; dropped: {dropped}")
    stdout.print(
        f"latency {latency['mean']:.0f} ms, 95 % {latency['p95']:.0f}, most {latency['max']:.0f}: "
        f"{summary['latency_frames']} frames of that rate"
    )
    for stage, ms in summary["stages_ms"].items():
        if ms is not None:
            stdout.print(f"  {stage}: {ms['mean']:.1f} ms, 95 % {ms['p95']:.1f}")
    sizes = ", then ".join(f"{particles} x {layers}" for _, particles, layers in summary["sizes"])
    stdout.print(f"particles x iterations: {sizes}")
    if summary["lost"]:
        stdout.print(f"the person was lost in {summary['lost']} of them")
    if "error_mm" in summary:
        stdout.print(f"mean error {summary['error_mm']:.1f} mm from the truth of the frames taken")
    if summary.get("error_when_known_mm") is not None:
        stdout.print(f"and {summary['error_when_known_mm']:.1f} mm from that when poses were known")
    stdout.print(f"{folder}: track.npz, joints.trc, live.json, timeline.png", soft_wrap=True)
