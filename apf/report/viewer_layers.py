"""Layers of a track for the viewer of psfs, on top of the voxels: skeleton and cones."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import trimesh

from apf.body.mesh import cone_mesh
from apf.body.model import BodyModel
from apf.report.scene_colours import LOST, colour_by_side
from apf.tracking.track import Track
from psfs.mesh.drawing import Layer, Lines, SurfaceDrawing

_BONE = (20, 20, 20)  # RGB of the skeleton
_BONE_WIDTH = 6.0  # px
_OPACITY = 0.75  # of the cones: their content stays visible
_VERTICES_PER_CONE = 34
#: Frames of which the cones are kept.
_KEPT = 16


def skeleton_layer(track: Track) -> Layer:
    """Return the layer of the joints' edges, in `LOST` where the person was lost."""
    rows = {int(frame): row for row, frame in enumerate(track.frames)}

    @lru_cache(_KEPT)
    def drawing(frame: int) -> Lines | None:
        if frame not in rows:
            return None
        row = rows[frame]
        colour = np.array(LOST if track.lost[row] else _BONE, np.uint8)
        colours = np.tile(colour, (len(track.edges), 1))
        return Lines(track.joints[row], track.edges, colours, _BONE_WIDTH)

    return Layer("skeleton", lambda frame, _colouring: drawing(frame))


def cone_layer(track: Track, body: BodyModel) -> Layer:
    """Return the layer of the posed cones of `body`, the scaled model that was tracked, in the
    colours of the overlay: one per side of the body."""
    rows = {int(frame): row for row, frame in enumerate(track.frames)}
    mesh = cone_mesh(body, _VERTICES_PER_CONE)
    of_cone = colour_by_side(mesh.names)
    # Every triangle has corners of its own: with shared ones Open3D 0.20 presented no frame of
    # these cones on Mesa's software Vulkan.
    corners = mesh.faces.ravel()
    faces = np.arange(len(corners)).reshape(-1, 3)
    colours = np.repeat(of_cone, _VERTICES_PER_CONE, axis=0)[corners]

    @lru_cache(_KEPT)
    def drawing(frame: int) -> SurfaceDrawing | None:
        if frame not in rows:
            return None
        vertices = mesh.posed(body, track.poses[rows[frame]][None])[0][0]
        normals = trimesh.Trimesh(vertices, mesh.faces, process=False).vertex_normals
        return SurfaceDrawing(vertices[corners], faces, normals[corners], colours, _OPACITY)

    return Layer("cones", lambda frame, _colouring: drawing(frame))


def describe_frame(track: Track, frame: int) -> str:
    """Return the caption of a frame: the tracker's state."""
    found = np.flatnonzero(track.frames == frame)
    if not len(found):
        return "not tracked"
    if track.lost[found[0]]:
        return "LOST"
    confidence = track.confidence[found[0]]
    return "" if np.isnan(confidence) else f"confidence {confidence:.2f}"
