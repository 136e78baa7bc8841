"""Surfaces are closed, free of debris, in place and not shrunk; files conform to their formats."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy import ndimage

from cl import InputError
from psfs.mesh.marching_cubes import extract_surface, occupied_box, vertex_colours, write_mesh
from psfs.voxels.grid import VoxelCloud, VoxelGrid

GRID = VoxelGrid(np.array([-1.0, 2.0, 0.5]), 0.04, (40, 37, 43))
CENTRE, RADIUS = np.array([-0.25, 2.7, 1.35]), 0.55


def ball(centre: np.ndarray = CENTRE, radius: float = RADIUS) -> np.ndarray:
    """Return the smoothed probability of a ball, as the reconstruction computes it: steep, not a
    step."""
    distance = np.linalg.norm(GRID.centres() - centre, axis=1).reshape(GRID.shape) - radius
    return ndimage.uniform_filter((distance < 0).astype(np.float32), 3)


def distance_to_surface(mesh: trimesh.Trimesh) -> np.ndarray:
    return np.linalg.norm(mesh.vertices - CENTRE, axis=1) - RADIUS


@pytest.mark.parametrize("smoothing", [0, 50])
def test_a_ball_stays_a_ball(smoothing: int) -> None:
    mesh = extract_surface(ball(), GRID, 0.5, smoothing)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.euler_number == 2
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.02)  # > 0: faces outwards
    assert np.abs(distance_to_surface(mesh)).max() < GRID.voxel_size


def test_smoothing_takes_the_steps_away() -> None:
    cubes = (ball() > 0.5).astype(np.float32)
    rough, smooth = (extract_surface(cubes, GRID, 0.5, steps) for steps in (0, 10))
    assert smooth.face_adjacency_angles.mean() < 0.7 * rough.face_adjacency_angles.mean()
    assert smooth.volume == pytest.approx(rough.volume, rel=0.005)


def test_a_body_cut_by_the_grid_is_closed_at_its_border() -> None:
    mesh = extract_surface(np.ones(GRID.shape, np.float32), GRID, 0.5, smoothing=0)
    assert mesh.is_watertight
    np.testing.assert_allclose(mesh.bounds, [GRID.low, GRID.high], atol=1e-6)


@pytest.mark.parametrize("seed", range(2))
def test_noise_gives_closed_meshes(seed: int) -> None:
    noise = np.random.default_rng(seed).random((17, 12, 21)).astype(np.float32)
    noise = ndimage.uniform_filter(np.where(noise > 0.5, np.float32(1), np.float32(0)), 3)
    mesh = extract_surface(noise, VoxelGrid(np.zeros(3), 1.0, noise.shape), 0.5, debris=0)
    assert mesh.is_watertight and mesh.volume > 0


def test_debris_goes_and_cavities_are_filled() -> None:
    body = ball()
    body[20, 18, 21] = body[19, 18, 20] = 0  # inside
    crumb = ball(CENTRE + np.array([0, 0.45, 0.6]), 0.1)
    mesh = extract_surface(np.maximum(body, crumb), GRID, 0.5)
    assert mesh.body_count == 1
    assert mesh.volume == pytest.approx(extract_surface(ball(), GRID, 0.5).volume)
    assert extract_surface(np.maximum(body, crumb), GRID, 0.5, debris=0).body_count == 2
    assert extract_surface(np.maximum(body, crumb), GRID, 0.5, debris=1).body_count == 1


def test_nothing_occupied_is_said() -> None:
    with pytest.raises(InputError, match=r"no voxel has a probability above 0\.6"):
        extract_surface(np.zeros(GRID.shape, np.float32), GRID)


def cloud(colour: bool) -> VoxelCloud:
    """Return the ball's voxels, red above CENTRE's height and blue below."""
    indices = np.flatnonzero(ball() > 0.5).astype(np.int32)
    red = GRID.centres(indices)[:, 2] > CENTRE[2]
    colours = np.where(red[:, None], np.uint8([200, 0, 0]), np.uint8([0, 0, 100]))
    probability = np.ones(len(indices), np.float32)
    return VoxelCloud(GRID, indices, probability, colours if colour else None)


def test_vertices_take_the_nearest_voxels_colour() -> None:
    mesh = extract_surface(ball(), GRID, 0.5, cloud=cloud(True))
    colours = vertex_colours(mesh)
    assert colours is not None
    above = mesh.vertices[:, 2] > CENTRE[2] + GRID.voxel_size
    below = mesh.vertices[:, 2] < CENTRE[2] - GRID.voxel_size
    assert (colours[above] == [200, 0, 0]).all() and (colours[below] == [0, 0, 100]).all()
    assert vertex_colours(extract_surface(ball(), GRID, 0.5, cloud=cloud(False))) is None


def test_the_box_holds_the_cloud_and_a_voxel_around_it() -> None:
    grid = VoxelGrid(np.array([1.0, 2.0, 3.0]), 0.5, (9, 8, 7))
    voxels = np.ravel_multi_index(([0, 4], [3, 5], [2, 6]), grid.shape)
    box = occupied_box(VoxelCloud(grid, voxels, np.ones(2, np.float32)))
    np.testing.assert_allclose(box.low, [1.0, 3.0, 3.5])  # no voxel below x = 0
    assert box.shape == (6, 5, 6)  # none above z = 6


@pytest.mark.parametrize("coloured", [False, True])
@pytest.mark.parametrize("suffix", ["ply", "obj"])
def test_ply_is_z_up_and_obj_y_up_and_say_so(tmp_path: Path, suffix: str, coloured: bool) -> None:
    mesh = extract_surface(ball(), GRID, 0.5, cloud=cloud(coloured))
    write_mesh(mesh, tmp_path / f"ball.{suffix}")
    x, y, z = mesh.vertices.T
    up, expected = {"ply": (b"Z", mesh.vertices), "obj": (b"Y", np.stack([x, z, -y], -1))}[suffix]
    said = (tmp_path / f"ball.{suffix}").read_bytes()[:200]
    assert b"unit metre; right-handed, %s up" % up in said
    again = trimesh.load(tmp_path / f"ball.{suffix}", process=False)
    assert isinstance(again, trimesh.Trimesh) and again.is_watertight
    np.testing.assert_allclose(again.vertices, expected, atol=2e-6)
    colours = vertex_colours(mesh)
    if colours is not None:
        np.testing.assert_array_equal(vertex_colours(again), colours)


@pytest.mark.parametrize("coloured", [False, True])
def test_glb_is_y_up_matte_and_of_linear_colours(tmp_path: Path, coloured: bool) -> None:
    mesh = extract_surface(ball(), GRID, 0.5, cloud=cloud(coloured))
    write_mesh(mesh, tmp_path / "ball.glb")
    content = (tmp_path / "ball.glb").read_bytes()
    (length,) = struct.unpack_from("<I", content, 12)
    tree = json.loads(content[20 : 20 + length])
    surface = tree["materials"][tree["meshes"][0]["primitives"][0]["material"]]
    assert surface["pbrMetallicRoughness"]["metallicFactor"] == 0
    scene = trimesh.load(tmp_path / "ball.glb", process=False)
    (again,) = scene.geometry.values()
    x, y, z = mesh.vertices.T
    np.testing.assert_allclose(again.vertices, np.stack([x, z, -y], -1), atol=1e-6)
    assert again.volume == pytest.approx(mesh.volume, rel=1e-4)
    assert ("COLOR_0" in tree["meshes"][0]["primitives"][0]["attributes"]) == coloured
    if coloured:  # sRGB 200 and 100 in linear light
        assert set(np.unique(again.visual.vertex_attributes["color"][:, :3])) == {0, 147, 32}
