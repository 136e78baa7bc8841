"""A track in the viewer: its skeleton and its cones, where and when they belong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from helpers.tracks import walker

from apf.body import load_body
from apf.body.kinematics import posed_cones
from apf.report.scene_colours import LOST
from apf.report.viewer_layers import cone_layer, describe_frame, skeleton_layer
from psfs.common.cones import cone_distances
from psfs.mesh.drawing import Lines, SurfaceDrawing


def test_the_skeleton_of_a_frame() -> None:
    track = walker(5, start=10)
    layer = skeleton_layer(track)
    lines = layer.drawing(12, "colour")
    assert isinstance(lines, Lines)
    np.testing.assert_array_equal(lines.points, track.joints[2])
    np.testing.assert_array_equal(lines.pairs, track.edges)
    assert layer.drawing(12, "height") is lines  # nothing to draw anew
    assert layer.drawing(9, "colour") is None and layer.drawing(15, "colour") is None


def test_a_lost_person_has_another_colour() -> None:
    track = walker(3)
    lost = replace(track, diagnostics={"lost": np.array([False, True, False])})
    layer = skeleton_layer(lost)
    gone, dark = layer.drawing(1, "colour"), layer.drawing(2, "colour")
    assert isinstance(gone, Lines) and isinstance(dark, Lines)
    assert (gone.colours == LOST).all() and (dark.colours < 50).all()


def test_cones_are_drawn_where_they_are() -> None:
    track, body = walker(4), load_body("song31")
    layer = cone_layer(track, body)
    surface = layer.drawing(3, "colour")
    assert isinstance(surface, SurfaceDrawing) and surface.opacity < 1
    nearest = cone_distances(surface.vertices, posed_cones(body, track.poses[3:])[0]).min(-1)
    assert nearest.max() < 1e-3  # on a cone, or in another one
    triangles = len(surface.colours) // len(body.cones)
    left, right = (
        surface.colours[triangles * body.cone_names.index(f"{side}_thigh")] for side in ("l", "r")
    )
    assert (left != right).any()
    assert len(surface.colours) == len(surface.normals) == len(surface.vertices)
    assert layer.drawing(4, "colour") is None


def test_notes() -> None:
    track = replace(
        walker(3),
        diagnostics={"confidence": np.array([0.5, 0.1, np.nan]), "lost": np.array([0, 1, 0])},
    )
    notes = [describe_frame(track, frame) for frame in range(4)]
    assert notes == ["confidence 0.50", "LOST", "", "not tracked"]
