"""Export of a finished track to motion files that other programs read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from apf.formats.angles import write_angle_csv
from apf.formats.c3d import C3dEvent, write_c3d
from apf.formats.glb import write_glb
from apf.formats.opensim.setup import write_opensim
from apf.formats.usd import write_usd
from apf.tracking.config import (
    EXPORTS,
    MESH_FOLDER,
    MESHES,
    OF_POINTS,
    OPENSIM,
    OPENSIM_FOLDER,
    USD,
    SmoothingConfig,
)
from apf.tracking.gait import Gait, measure_gait
from apf.tracking.smoothing import smooth_track
from apf.tracking.track import Track
from cl import InputError
from psfs.cameras.names import join_names
from psfs.common.files import write_json
from psfs.mesh.marching_cubes import write_mesh

_LABELS = {"strike": "Foot Strike", "off": "Foot Off"}


@dataclass(frozen=True, eq=False)
class Export:
    """The `files` that were written, and the `track` that they contain. gait: computed for the gait
    file and for C3D, which holds its events; None if nobody walks, and then no gait file is
    written."""

    files: tuple[Path, ...]
    track: Track
    gait: Gait | None


def export(
    track: Track,
    folder: str | Path,
    to: Sequence[str] | None = None,
    *,
    axes: str = "y-up",
    smoothing: SmoothingConfig | None = None,
    raw: bool = False,
    osim_model: Path | None = None,
) -> Export:
    """Write `track` into `folder` in each of the formats `to`, keys of EXPORTS, or `osim`; by
    default in all of EXPORTS that the track allows.

    The track is smoothed first, unless it is smoothed already, `raw` is set, or it has no body.
    axes: of the TRC, see `Track.save`. osim_model: the OpenSim model that `osim` scales, by default
    the one that Pose2Sim carries. Raises InputError for a format that is not in EXPORTS, if the
    track does not hold a body that a file needs, and if a file cannot be written.
    """
    has_body, known = bool(track.dof_names), (*EXPORTS, OPENSIM, USD, *MESHES)
    chosen = dict.fromkeys(to or (EXPORTS if has_body else OF_POINTS))
    for kind in chosen:
        if kind not in known:
            raise InputError(f"a track is not exported as {kind!r}; expected {join_names(known)}")
        if not has_body and kind not in OF_POINTS:
            raise InputError(
                f"a track of points, without a body, is not exported as {kind!r}; expected "
                f"{join_names(OF_POINTS)}"
            )
    if has_body and not raw and track.smoothing is None:
        track = smooth_track(track, smoothing)
    gait = measure_gait(track) if {"gait", "c3d"} & set(chosen) else None
    written: list[Path] = []
    for kind in chosen:
        if kind in MESHES:
            written += _write_meshes(track, Path(folder) / MESH_FOLDER, kind)
        elif kind == OPENSIM:
            written += write_opensim(Path(folder) / OPENSIM_FOLDER, track.motion, osim_model)
        else:
            name = EXPORTS.get(kind, "person.usda")
            written += _write(track, gait, kind, Path(folder) / name, axes)
    return Export(tuple(written), track, gait)


def _write_meshes(track: Track, folder: Path, kind: str) -> list[Path]:
    """Write the person's surface in each frame that shows it, and return the files."""
    if track.surface is None:
        return []
    import trimesh  # slow to import

    folder.mkdir(parents=True, exist_ok=True)
    mesh, written = track.surface.bind(track.its_body), list[Path]()
    colours = track.surface.colours if len(track.surface.colours) else None
    for row in np.flatnonzero(~track.lost):
        vertices = mesh.posed(track.its_body, track.poses[[row]])[0][0]
        shape = trimesh.Trimesh(vertices, mesh.faces, vertex_colors=colours, process=False)
        written.append(folder / f"person_{track.frames[row]:06d}.{kind}")
        write_mesh(shape, written[-1])
    return written


def _write(track: Track, gait: Gait | None, kind: str, path: Path, axes: str) -> tuple[Path, ...]:
    """Write a format and return its files, more than one of a C3D too long for its counts, none of
    a gait that is none and of a person whose surface is not known."""
    if kind == "csv":
        write_angle_csv(path, track.angles, track.points)
    elif kind == "c3d":
        events = gait.events if gait is not None else ()
        labelled = [C3dEvent(_LABELS[e.kind], e.side.capitalize(), e.time) for e in events]
        return write_c3d(path, track.points, labelled)
    elif kind in ("person", USD):
        if track.surface is None:
            return ()
        write = write_glb if kind == "person" else write_usd
        write(path, track.motion, track.surface)
    elif kind == "gait":
        if gait is None:
            return ()
        write_json(path, gait.describe())
    else:
        track.save(path, axes)
    return (path,)
