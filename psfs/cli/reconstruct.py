"""`psfs reconstruct FOLDER -o OUT`: a voxel cloud for every frame."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from cl import Device, InputError, UserError, select_device
from psfs.cli.commandline import progress_bar, stdout, warn
from psfs.common.files import write_json, write_picture
from psfs.common.outputs import PART_SECONDS, OutputFolder, output_folder
from psfs.common.requests import SETTINGS, write_settings
from psfs.common.system import versions
from psfs.diagnostics.reprojection_iou import (
    describe_cut_silhouettes,
    share_beyond_volume,
    volume_region,
    whole_silhouettes,
)
from psfs.opening import (
    Reconstruction,
    open_sequence,
    prepare_reconstruction,
    select_frames,
    stated_keys,
)
from psfs.output import reconstruction_folder
from psfs.output.preview import draw_preview
from psfs.request import ReconstructRequest
from psfs.sequence import Sequence
from psfs.volume import describe_expected_person
from psfs.voxels.body_prior import TrackedBody
from psfs.voxels.clouds import remove_debris, write_cloud
from psfs.voxels.grid import VoxelCloud, VoxelGrid
from psfs.voxels.occupied_box import PEOPLE_VOXEL, finest_pixel

#: Frames whose silhouettes are compared with the volume.
_COMPARED = 8
#: Least volume of somebody who stands, litres: what a child of a year weighs, kg.
_LEAST_PERSON = 9.0
#: A warning is given if voxels are smaller than a pixel by more than this factor.
_FINE = 2.0


def run(request: ReconstructRequest) -> None:
    expected = (
        reconstruction_folder.SUMMARY,
        "preview.png",
        SETTINGS,
        *reconstruction_folder.CLOUDS,
    )
    folder = request.output or Path()
    with output_folder(folder, request.COMMAND, [request.folder], expected) as out:
        _reconstruct(request, out)


def _reconstruct(request: ReconstructRequest, out: OutputFolder) -> None:
    with progress_bar() as bar:
        task = bar.add_task("examining", total=None)
        device = select_device(request.device, profile=True)
        opened = open_sequence(request)
        body = None if request.track is None else TrackedBody.open(request.track)
        out.check_inputs([*opened.inputs, *([] if body is None else [body.path])])
        select_frames(request.frames, opened)  # before the examination, which takes seconds
        prepared = prepare_reconstruction(request, opened, device, warn, body)
        session, grid = prepared.session, prepared.grid
        sequence, frames = session.sequence, session.frames
        _warn_of_fine_voxels(grid, sequence)
        job = _Job(prepared)
        try:
            bar.update(task, description="reconstructing", total=len(frames))
            for frame in sequence.frames(session.settings.selection):
                job.reconstruct(frame)
                bar.advance(task)
        except BaseException as error:
            with suppress(UserError, KeyboardInterrupt):  # what is finished is written
                job.finish()
            if job.done and isinstance(error, UserError):
                raise InputError(
                    f"{error}; {job.n_stated} of {len(frames)} frames are in {request.output}"
                ) from error
            raise
    job.finish()
    if not job.done:
        raise InputError(
            f"{sequence.folder}: nothing stands out from the background in the volume from "
            f"{grid.low.round(3)} to {grid.high.round(3)} m, "
            f"{' x '.join(map(str, grid.shape))} voxels of {grid.voxel_size:g} m; "
            f"expected {describe_expected_person(sequence)}"
        )
    job.report()
    litres = max(frame["volume_m3"] for frame in job.done) * 1e3
    people = sequence.subject != "object" and grid.voxel_size >= PEOPLE_VOXEL
    if litres < _LEAST_PERSON and people and sequence.volume is None:
        raise InputError(
            f"{sequence.folder}: at most {litres:.2g} litres stand out; a person has "
            f"{_LEAST_PERSON:g} or more. Do pictures of the background show the person, too? For a "
            "part or an object, state --volume or --subject object"
        )


def _warn_of_fine_voxels(grid: VoxelGrid, sequence: Sequence) -> None:
    pixel = finest_pixel(sequence.rig, grid)
    if grid.voxel_size > pixel / _FINE:
        return
    warn(
        f"{grid.size:,} voxels of {1e3 * grid.voxel_size:.2g} mm: finer than "
        f"the pictures, whose pixels cover {1e3 * pixel:.2g} mm there; --voxel-size {pixel:.1g} "
        f"would show as much in {(grid.voxel_size / pixel) ** 2:.2g} of the time"
    )


class _Job:
    """One run: reconstruction frame by frame, and the records of it.

    Nothing is written before the first non-empty cloud.
    """

    def __init__(self, prepared: Reconstruction) -> None:
        session, self.request, self.grid = prepared.session, prepared.request, prepared.grid
        self.prepared, self.out = prepared, self.request.output or Path()
        self.sequence, self.device = session.sequence, session.device
        self.expected = len(session.frames)
        self.n_stated, self._stated_at = 0, -math.inf
        self.done: list[dict[str, Any]] = []
        self._waiting: list[tuple[int, VoxelCloud]] = []  # empty clouds before the first full one
        self._ms: dict[str, list[float]] = defaultdict(list)
        self._region = volume_region(session.rig, self.grid)
        self._beyond: list[np.ndarray] = []

    def reconstruct(self, frame: Any) -> None:
        started = time.perf_counter()
        voxels = self.prepared.reconstructor(frame)
        if isinstance(self.device, Device):
            self.device.finish()
        computed = time.perf_counter()
        if len(self.done) % max(1, self.expected // _COMPARED) == 0:
            silhouettes = self.prepared.reconstructor.evidence() > 0
            whole = whole_silhouettes(silhouettes, self._region)
            self._beyond.append(share_beyond_volume(whole, self._region))
        colour = self.request.colour and frame.images is not None
        cloud = remove_debris(voxels.cloud(colour=colour), self.request.debris)
        downloaded = time.perf_counter()
        self._waiting.append((frame.index, cloud))
        if len(cloud) or self.done:
            self._write()
        written = time.perf_counter()
        self._ms["reconstruct (whole)"].append(1e3 * (computed - started))
        self._ms["colour, download, debris"].append(1e3 * (downloaded - computed))
        self._ms["write"].append(1e3 * (written - downloaded))

    def _write(self) -> None:
        for index, cloud in self._waiting:
            stem = reconstruction_folder.cloud_stem(self.out, index)
            write_cloud(cloud, stem, self.request.normals)
            fact = {"index": index, "surface_voxels": len(cloud), "volume_m3": cloud.volume}
            self.done.append(fact)
        self._waiting.clear()
        if time.perf_counter() - self._stated_at > PART_SECONDS:
            self._state()

    def _state(self) -> None:
        """Write the summary of the finished frames, in case the process is killed."""
        write_json(self.out / reconstruction_folder.SUMMARY, self._summary())
        self.n_stated, self._stated_at = len(self.done), time.perf_counter()

    def finish(self) -> None:
        """Write summary and preview of the finished frames."""
        if not self.done:
            return
        cut = describe_cut_silhouettes(self.sequence.rig.names, np.array(self._beyond))
        if cut:
            warn(cut)
        self._state()
        write_settings(self.out, self.request, ["reconstruction"])
        full = [frame["index"] for frame in self.done if frame["surface_voxels"]]
        index = full[len(full) // 2]
        run = reconstruction_folder.ReconstructionFolder.open(self.out)
        title = f"{self.sequence.name}, frame {index}"
        picture = draw_preview(
            run.cloud(index), self.sequence.rig, self.sequence.read(index), title
        )
        write_picture(self.out / "preview.png", picture)

    def _summary(self) -> dict[str, Any]:
        reasons = {s.cameras[0]: str(s) for s in self.prepared.examination.left_out}
        stated = stated_keys(self.request.capture)
        return {
            "sequence": reconstruction_folder.sequence_facts(
                self.sequence, self.out, stated, reasons
            ),
            "complete": len(self.done) == self.expected,
            "grid": reconstruction_folder.grid_facts(self.grid),
            "config": self.prepared.session.reconstruction.to_dict(),
            "debris_share": self.request.debris,
            "device": reconstruction_folder.device_facts(self.device),
            "versions": versions(),
            "median_ms": self.timings(),
            "frames": self.done,
        }

    def timings(self) -> dict[str, float]:
        """Return the median time of each stage, ms: on the host's clock, then on the device's."""
        rows = {name: float(np.median(ms)) for name, ms in self._ms.items()}
        profiler = self.device.profiler if isinstance(self.device, Device) else None
        if profiler is not None:
            rows |= {f"device: {name}": median for name, _, median, _ in profiler.table()}
        return {name: round(ms, 3) for name, ms in rows.items()}

    def report(self) -> None:
        nx, ny, nz = self.grid.shape
        counts = [frame["surface_voxels"] for frame in self.done]
        volumes = [frame["volume_m3"] * 1e3 for frame in self.done]
        whole = self.timings()["reconstruct (whole)"]
        stdout.print(
            f"{len(self.done)} frames, grid {nx} x {ny} x {nz} of "
            f"{self.grid.voxel_size * 1e3:.3g} mm, median {np.median(counts):,.0f} surface voxels, "
            f"{np.median(volumes):.3g} litres, {whole:.1f} ms per frame on {self.device.name}"
        )
        stdout.print(f"wrote {self.out}")
