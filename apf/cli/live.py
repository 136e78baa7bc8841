"""`apf live`: track a person live, from cameras or a recording played at its own rate."""

from __future__ import annotations

import time
import webbrowser
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from apf.backend import check_renderer
from apf.cli.live_start import read_live_people, start_captures, start_replay
from apf.evaluation.people import evaluate_people, find_followed
from apf.evaluation.truth import load_people_truth
from apf.filters.base import Estimate
from apf.filters.method import Method
from apf.formats.trc import JointSeries
from apf.live.pace import PaceReporter, expect_pace
from apf.live.send import open_senders, parse_target
from apf.live.session import Live, LiveResult, LiveStart, list_sizes
from apf.live.sources import fitting_factor
from apf.live.timeline import Timeline, live_errors, summarise_seconds
from apf.request import LiveRequest
from apf.takes.results import RESULTS, Keeper, remove_parts, write_people
from apf.takes.start import check_start
from apf.tracking.people import PeopleTracks, person_folder
from apf.tracking.pipeline import build_track
from apf.tracking.track import PARTS, Track
from cl import Device, InputError, UserError, select_device
from psfs.cli.commandline import stderr, stdout, warn
from psfs.common.files import write_json
from psfs.common.outputs import PART_SECONDS, output_folder
from psfs.common.requests import write_settings
from psfs.opening import open_sequence

#: True joints of each person by name.
Truth = dict[str, JointSeries]


def run(request: LiveRequest) -> None:
    check_start(request, request.truth)
    for text in request.send or ():
        parse_target(text)
    method = request.method
    if method.objective == "keypoints":
        raise InputError(
            "--objective keypoints: apf live reads none; expected voxels or image features"
        )
    if request.captures:
        request.refuse(["frames"], "applies only to a recording; expected none with --captures")
    else:
        request.refuse(["empty"], "applies only to --captures; expected them with it")
    # The frames are not evenly spaced, and `Live` predicts the motion itself.
    noise = method.filter.search.noise
    if method.uses_voxels and not request.states_noise:
        noise = request.live.noise
    method = method.replace(filter=method.filter.with_changes(velocity=0.0, noise=noise))
    device = select_device(request.device)
    if not isinstance(device, Device):
        raise InputError("--device numpy is no device for live tracking; expected an OpenCL device")
    check_renderer(device, method)
    number = read_live_people(request, method)
    file = request.truth
    truth = None if file is None else load_people_truth(file, request.convention)
    stated = [
        Path(path) for path in (request.init, request.body, request.truth) if path is not None
    ]
    if request.captures:
        folder = Path(request.folder)
        inputs = [folder, folder / "background", *map(Path, request.captures), *stated]
        inputs = [path for path in inputs if path.exists()]
    else:
        inputs = [*open_sequence(request).inputs, *(path for path in stated if path.exists())]
    with output_folder(request.output, request.COMMAND, inputs, (*RESULTS, "take*")):
        _live(request, method, device, number, truth)


def _live(
    request: LiveRequest,
    method: Method,
    device: Device,
    number: int | None,
    truth: Truth | None,
) -> None:
    """Run; number: of people, None for as many as are seen."""
    if request.captures:
        source, start = start_captures(request, method, number)
    else:
        source, start = start_replay(request, method, device, number)
    grid, several = start.grid, len(start.people) > 1
    sized_by_hand = not request.chosen.isdisjoint(("n_particles", "n_layers"))
    one_size = sized_by_hand and request.budget is None
    searches = [method] if one_size else list_sizes(method, request.live)
    follow = bool(request.captures) and request.capture.volume is None and not several
    scale = request.scale
    if scale is None:
        scale = 1.0 if device.is_gpu or grid is None else fitting_factor(source.rig, grid)
    live = Live(
        device,
        source,
        start,
        searches,
        budget=request.budget,
        follow=follow,
        scale=scale,
        config=request.live,
    )
    wanted = request.budget or source.fps
    keeps_up, words = expect_pace(live, wanted)
    if keeps_up:
        stderr.print(words)
    else:
        warn(words)
    provenance = {**method.describe(), "device": device.name}
    keep = TrackKeeper(request.replace(method=method), live, provenance)
    bodies = [person.body for person in live.persons]
    with open_senders(request.send or (), bodies) as senders:
        live.listeners = [sender.send for sender in senders]
        result, takes = _run(request, live, start, keep, wanted, not keeps_up)
    if not result.frames:
        raise result.error or InputError("no frame was tracked; expected at least one")
    try:
        keep.write_all(result, takes, truth)
    except InputError as error:  # such as a full disk
        if not any(keep.folder.glob("*")):  # it was full from the start
            raise
        raise InputError(f"{error}; what was tracked is in {keep.folder}") from error
    if result.error is not None:
        if not isinstance(result.error, UserError):
            raise result.error
        where = f"{len(result.frames)} poses are in {request.output}"
        raise InputError(f"{result.error}; {where}") from result.error


class TrackKeeper:
    """Writes the results of a run: while it goes on, the poses that are new every second, in case
    the process is killed, as what `Live.run` reports to; and all at its end."""

    def __init__(self, request: LiveRequest, live: Live, provenance: dict[str, Any]) -> None:
        output, several = request.output, len(live.persons) > 1
        numbers = range(1, len(live.persons) + 1)
        folders = [person_folder(output, k) for k in numbers] if several else [output]
        self._keepers = [Keeper([folder]) for folder in folders]
        self._folders, self._live, self._provenance = folders, live, provenance
        self._request = request
        self._poses = [person.pose for person in live.persons]
        self._newest, self._due = -1, 0.0

    def __call__(self, result: LiveResult, timeline: Timeline) -> None:
        if time.monotonic() < self._due or not result.latencies:
            return
        self._due = time.monotonic() + PART_SECONDS
        newest = result.frames[len(result.latencies) - 1]
        tracks = make_tracks(self._live, result, (self._newest + 1, newest), self._provenance)
        for keeper, pose, track in zip(self._keepers, self._poses, tracks, strict=False):
            keeper(track.its_body, pose, [track])
        self._newest = newest

    @property
    def folder(self) -> Path:
        """The folder of the parts, of the first of several people."""
        return (self._folders[0] / PARTS).parent

    def write_all(
        self, result: LiveResult, takes: list[tuple[int, int]], truth: Truth | None
    ) -> None:
        """Write and print the results; takes: first and last frames of recorded ones."""
        live, output, provenance = self._live, self._request.output, self._provenance
        for number, take in enumerate(takes, start=1):
            if recorded := make_tracks(live, result, take, provenance):
                write_people(output / f"take{number}", PeopleTracks.of(*recorded))
        write_settings(output, self._request, ["method", "live"])
        tracks = make_tracks(live, result, (0, result.frames[-1]), provenance)
        write_people(output, PeopleTracks.of(*tracks))
        summary = live.timeline.summary() | {"sizes": result.sizes, "scale": live.scale}
        summary["lost"] = sum(int(track.lost.sum()) for track in tracks)
        summary |= {"people": len(tracks)} if len(tracks) > 1 else {}
        summary |= compare_with_truth(tracks, result, truth)
        if result.sent_after:
            summary["packet_ms"] = summarise_seconds(np.array(result.sent_after))
        write_json(output / "live.json", summary)
        live.timeline.plot(output / "timeline.png")
        print_summary(summary, output)
        for folder in self._folders:  # the whole tracks are written
            remove_parts(folder)


def compare_with_truth(
    tracks: list[Track], result: LiveResult, truth: Truth | None
) -> dict[str, Any]:
    """Return the errors against the truth, for the summary."""
    if truth is None:
        return {}
    if len(tracks) == 1:
        series = truth[find_followed(tracks[0], truth)]
        return live_errors(tracks[0], series, np.array(result.latencies))
    if len(truth) == 1:
        warn(f"--truth is of one person, and {len(tracks)} were tracked; they are not compared")
        return {}
    return {"people_errors": evaluate_people(PeopleTracks.of(*tracks), truth).summary()}


def _run(
    request: LiveRequest,
    live: Live,
    start: LiveStart,
    keep: TrackKeeper,
    wanted: float,
    warned: bool,
) -> tuple[LiveResult, list[tuple[int, int]]]:
    """Run, with its progress on the terminal and, with --studio, on a page. Return the result, and
    the first and last frames of takes that were recorded on the page. wanted: poses per second;
    warned: whether the user knows that there will be fewer."""
    late = None if warned else warn
    with ExitStack() as stack:
        if stderr.console.is_terminal:
            waiting = stderr.console.status("waiting for the first frame; Ctrl-C ends")
            progress = PaceReporter(wanted, stack.enter_context(waiting).update, None, late)
        else:
            progress = PaceReporter(wanted, None, stderr.print, late)
        if not request.studio:
            return live.run([keep, progress], warn), []
        from apf.studio.live import LivePage  # imports an extra

        rig = live.source.rig
        page = stack.enter_context(closing(LivePage(start, rig, live.stop)))
        stdout.print(f"{page.address} (for this machine alone)")
        webbrowser.open(page.address)
        return live.run([keep, progress, page], warn), page.takes


def make_tracks(
    live: Live, result: LiveResult, take: tuple[int, int], provenance: dict[str, Any]
) -> list[Track]:
    """Return each person's track from the first to the last frame of a take; none without poses.

    Searches differ in their numbers of layers: of those of the largest, missing ones are NaN, so
    that the parts of a track can be joined.
    """
    known = result.frames[: len(result.latencies)]  # of a run that goes on
    rows = [row for row, frame in enumerate(known) if take[0] <= frame <= take[1]]
    frames = [result.frames[row] for row in rows]

    def pad(estimate: Estimate) -> Estimate:
        layers = np.array([estimate.ess, estimate.beta, estimate.least_error])
        missing = live.most_layers - layers.shape[1]
        ess, beta, least = np.pad(layers, ((0, 0), (0, missing)), constant_values=np.nan)
        return replace(estimate, ess=ess, beta=beta, least_error=least)

    return [
        build_track(
            person.body, live.source.fps, frames, [pad(found[row]) for row in rows], provenance
        ).judged
        for person, found in zip(live.persons, zip(*result.estimates, strict=True), strict=True)
        if rows
    ]


def print_summary(summary: dict[str, Any], folder: Path) -> None:
    """Print the figures of a run to standard output."""
    latency = summary["latency_ms"]
    dropped = ", ".join(f"{count} before {stage}" for stage, count in summary["dropped"].items())
    several = summary["fps"] is not None  # one pose has no rate
    rate = f", {summary['fps']} per second" if several else ""
    frames = f": {summary['latency_frames']} frames of that rate" if several else ""
    stdout.print(f"{summary['results']} poses{rate}; dropped: {dropped}")
    stdout.print(
        f"latency {latency['mean']:.0f} ms, 95 % {latency['p95']:.0f}, "
        f"most {latency['max']:.0f}{frames}"
    )
    if packet := summary.get("packet_ms"):
        stdout.print(f"from picture to packet {packet['mean']:.0f} ms, 95 % {packet['p95']:.0f}")
    for stage, ms in summary["stages_ms"].items():
        if ms is not None:
            stdout.print(f"  {stage}: {ms['mean']:.1f} ms, 95 % {ms['p95']:.1f}")
    sizes = ", then ".join(f"{particles} x {layers}" for _, particles, layers in summary["sizes"])
    stdout.print(f"particles x iterations: {sizes}")
    if summary["lost"]:
        of = "a person was lost" if summary.get("people", 1) > 1 else "the person was lost"
        stdout.print(f"{of} in {summary['lost']} of them")
    if "error_mm" in summary:
        stdout.print(f"mean error {summary['error_mm']:.1f} mm from the truth of the frames taken")
    for person in summary.get("people_errors", {}).get("persons", ()):
        if person["errors"] is not None:
            mean = person["errors"]["mean_error_mm"]
            stdout.print(f"{person['name']}: mean error {mean:.1f} mm, track {person['track']}")
    if summary.get("error_when_known_mm") is not None:
        stdout.print(f"and {summary['error_when_known_mm']:.1f} mm from that when poses were known")
    tracks = "person1 and so on, people.json" if "people" in summary else "track.npz, joints.trc"
    stdout.print(f"{folder}: {tracks}, live.json, timeline.png")
