"""A person's surface: found from outlines, moved by the bones, written, painted, measured."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pygltflib
import pytest
import trimesh
from helpers import bodies
from helpers.gltf import gltf_nodes, gltf_values
from helpers.outlines import outlines_of
from helpers.striders import strider

from apf.body.kinematics import posed_cones
from apf.body.surface import Surface, paint
from apf.formats.skeleton import TO_Y_UP
from apf.initialisation.surface import fit_surface, join_cones
from apf.tracking.motion_files import export
from apf.tracking.track import Track
from psfs.common.cones import cone_distances

BODY = strider(1).its_body
LENGTHS = np.full(len(BODY.edges), 0.01)


@pytest.fixture(scope="module")
def found() -> tuple[np.ndarray, Surface]:
    """Poses of a person who is wider than the body, and the surface from the outlines."""
    wide = BODY.scaled({}, 1.15)
    poses = bodies.random_poses(BODY, 5)
    poses[:, :3] = BODY.rest_pose[:3]
    outlines = [outlines_of(cones) for cones in posed_cones(wide, poses)]
    return poses, fit_surface(BODY, outlines, poses, LENGTHS)


def test_surface_lies_where_the_outlines_touch(found: tuple[np.ndarray, Surface]) -> None:
    """Its measures have errors."""
    _, surface = found
    wide = posed_cones(BODY.scaled({}, 1.15), surface.pose[None])[0]
    before = cone_distances(join_cones(BODY, surface.pose)[0], wide).min(1)
    after = cone_distances(surface.vertices, wide).min(1)
    assert np.abs(after).mean() < 0.75 * np.abs(before).mean()
    assert np.all(surface.deviation <= 0.03 + 1e-9)
    measures = surface.measure(BODY)
    volume, error = measures["volume_l"]
    assert 40 < volume < 150 and 0 < error < 0.2 * volume
    girth, deviation = measures["girths_m"]["l_thigh"]
    assert 0.3 < girth < 0.9 and 0 < deviation < 0.1


def test_what_is_carried_is_no_part_of_the_surface(found: tuple[np.ndarray, Surface]) -> None:
    load = replace(
        BODY.cones[0], name="load_1", bone=0,
        start=np.array([0.5, 0, -0.1]), end=np.array([0.5, 0, 0.2]), radii=(0.2, 0.2),
    )  # fmt: skip
    poses, alone = found
    loaded = replace(BODY, cones=(*BODY.cones, load))
    outlines = [outlines_of(cones) for cones in posed_cones(loaded, poses)]
    surface = fit_surface(loaded, outlines, poses, LENGTHS)
    cones = posed_cones(BODY, surface.pose[None])[0]
    assert cone_distances(surface.vertices, cones).min(1).max() < 0.1
    measures, expected = surface.measure(loaded), alone.measure(BODY)
    assert measures["girths_m"].keys() == expected["girths_m"].keys()
    assert measures["volume_l"][0] < 1.1 * expected["volume_l"][0]


def test_girths_are_those_of_the_cones() -> None:
    pose = bodies.bent(BODY, l_upper_arm__rx=1.0, r_upper_arm__rx=1.0)  # away from the trunk
    vertices, faces = join_cones(BODY, pose)
    alike = np.full(len(vertices), 0.005)
    surface = Surface(pose, vertices, faces, alike, np.array(0.0), LENGTHS, np.zeros((0, 3)))
    girths = surface.measure(BODY)["girths_m"]
    for cone in BODY.cones:
        if cone.name[2:] in ("thigh", "calf", "upper_arm", "forearm"):
            assert girths[cone.name][0] == pytest.approx(np.pi * sum(cone.radii), rel=0.01)
    assert 0.7 < girths["hips"][0] < 1.1 and girths["shoulders"][0] < 1.3


def test_vertices_take_the_nearest_colours(found: tuple[np.ndarray, Surface]) -> None:
    poses, surface = found
    posed = surface.bind(BODY).posed(BODY, poses[:3])[0]
    red = np.tile(np.array([200, 10, 10], np.uint8), (len(posed[0]), 1))
    red[posed[0][:, 2] < 1] = 0
    colours = paint(surface, BODY, poses[:3], [(of, red) for of in posed])
    np.testing.assert_array_equal(colours, red)


def test_glb_moves_the_surface(tmp_path: Path, found: tuple[np.ndarray, Surface]) -> None:
    colours = np.full((len(found[1].vertices), 3), 128, np.uint8)
    track = replace(strider(12), surface=replace(found[1], colours=colours))
    track.save(tmp_path / "track.npz")
    track = Track.open(tmp_path)
    (path,) = export(track, tmp_path, ["person"], raw=True).files
    assert export(strider(12), tmp_path, ["person"]).files == ()  # without a surface
    file = pygltflib.GLTF2().load(path)
    attributes = file.meshes[0].primitives[0].attributes
    points, owners, weights, shown = (
        gltf_values(file, getattr(attributes, kind))
        for kind in ("POSITION", "JOINTS_0", "WEIGHTS_0", "COLOR_0")
    )
    np.testing.assert_allclose(shown, 0.2158, atol=1e-3)  # half of sRGB's range, linear
    np.testing.assert_allclose(weights.sum(1), 1, atol=1e-6)
    unbind = gltf_values(file, file.skins[0].inverseBindMatrices).reshape(-1, 4, 4)
    bound = gltf_nodes(file, 7)[file.skins[0].joints] @ unbind.transpose(0, 2, 1)
    ones = np.column_stack([points, np.ones(len(points))])
    skin = np.einsum("vk,vkab,vb->va", weights, bound[owners], ones)[:, :3] @ TO_Y_UP
    assert track.surface is not None
    posed = track.surface.bind(BODY).posed(BODY, track.poses[[7]])[0][0]
    np.testing.assert_allclose(skin, posed, atol=1e-4)


def test_usd_and_meshes_hold_the_surface(tmp_path: Path, found: tuple[np.ndarray, Surface]) -> None:
    track = replace(strider(4), surface=found[1])
    files = export(track, tmp_path, ["usd", "ply", "obj"], raw=True).files
    text = files[0].read_text()
    assert files[0].name == "person.usda" and text.count("{") == text.count("}")
    assert '"Hips/Spine/Head"' in text and "\n            3: [" in text
    assert len(files) == 1 + 2 * 4
    posed = found[1].bind(BODY).posed(BODY, track.poses[[3]])[0][0]
    mesh = trimesh.load(tmp_path / "meshes" / "person_000003.ply")
    assert isinstance(mesh, trimesh.Trimesh)
    np.testing.assert_allclose(mesh.vertices, posed, atol=1e-5)
