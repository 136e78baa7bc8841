"""Body meshes: frusta, users' meshes, and their rendering compared with the twin."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from helpers import bodies, rendered, scenes
from helpers.kinds import other_kind

import apf.image_objective.renderer
from apf.body.mesh import FRUSTUM_VERTICES, BodyMesh, cone_mesh, load_mesh, skinned_mesh
from apf.body.model import BodyModel
from apf.body.toml import load_body
from cl import Device, InputError


def blob(body: BodyModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices (M, 3) and faces of a closed surface around the resting stick, and blend
    weights (M, B)."""
    ball = trimesh.creation.icosphere(2)
    vertices = ball.vertices * [0.25, 0.25, 0.6] + [0.1, -0.15, 0.6]
    above = np.clip((vertices[:, 2] - 0.3) / 0.6, 0, 1)
    weights = np.zeros((len(vertices), len(body.bones)))
    weights[:, 0], weights[:, 1] = 1 - above, above
    return vertices, ball.faces, weights


def soft_mesh(body: BodyModel) -> BodyMesh:
    return skinned_mesh(*blob(body), body, body.rest_pose)


@pytest.mark.parametrize("n", FRUSTUM_VERTICES)
def test_frusta_are_closed_and_as_large_as_their_cones(n: int) -> None:
    body = load_body("song31")
    mesh = cone_mesh(body, n)
    vertices, middles = mesh.posed(body, body.rest_pose[None])
    for part, cone in enumerate(body.cones):
        solid = trimesh.Trimesh(vertices[0], mesh.faces[mesh.parts == part], process=False)
        solid.remove_unreferenced_vertices()
        assert len(solid.vertices) == n
        assert solid.is_watertight
        a, b = cone.radii
        height = np.linalg.norm(cone.end - cone.start)
        volume = np.pi / 3 * height * (a * a + a * b + b * b) * np.prod(cone.scale)
        ring = (n - 2) // 2
        inscribed = 1.0 if n == 8 else ring / (2 * np.pi) * np.sin(2 * np.pi / ring)
        assert solid.volume == pytest.approx(volume * inscribed)
    assert middles.shape == (1, len(body.cones), 3)


def test_a_skinned_mesh_rests_where_it_was_bound() -> None:
    body = bodies.named("stick")
    vertices, _, weights = blob(body)
    mesh = soft_mesh(body)
    np.testing.assert_allclose(mesh.posed(body, body.rest_pose[None])[0][0], vertices, atol=1e-12)
    bent = body.rest_pose.copy()
    bent[0] += 0.3  # turns the upper bone alone
    moved = np.linalg.norm(mesh.posed(body, bent[None])[0][0] - vertices, axis=-1)
    assert moved[weights[:, 1] == 0].max() < 1e-12
    assert moved[weights[:, 1] == 1].max() > 0.05
    assert mesh.names == ("l_lower", "upper")


@pytest.mark.parity("image/skin.project_vertices", "image/render_mesh.count_pixels")
@pytest.mark.parametrize("mesh_of", [lambda body: cone_mesh(body, 66), soft_mesh])
def test_pictures_equal_the_twins(device: Device, mesh_of: Callable[..., BodyMesh]) -> None:
    body, rig = bodies.named("stick"), scenes.ring(3, (161, 123))
    rendered.check_pictures(device, body, rig, bodies.scattered_poses(body, 6), mesh_of(body))


def test_a_gpus_work_groups_draw_the_same(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """On any device: many work-items per picture, and bodies higher than a band of rows."""
    device = device if device.is_gpu else other_kind(device)
    monkeypatch.setattr(apf.image_objective.renderer, "_GPU_BYTES", 4096)
    body, rig = bodies.named("song31"), scenes.ring(2, (161, 123))
    poses = bodies.scattered_poses(body, 6)
    rendered.check_pictures(device, body, rig, poses, cone_mesh(body, 18))


def test_a_users_mesh_is_read_and_wrong_ones_named(tmp_path: Path) -> None:
    body = bodies.named("stick")
    vertices, faces, weights = blob(body)
    trimesh.Trimesh(vertices, faces, process=False).export(tmp_path / "person.ply")
    names = [bone.name for bone in body.bones]
    np.savez(tmp_path / "w.npz", weights=2 * weights[:, ::-1], bones=names[::-1])
    mesh = load_mesh(tmp_path / "person.ply", body, body.rest_pose, tmp_path / "w.npz")
    expected = soft_mesh(body)
    np.testing.assert_allclose(mesh.weights, expected.weights, atol=1e-6)
    np.testing.assert_allclose(mesh.positions, expected.positions, atol=1e-6)
    rigid = load_mesh(tmp_path / "person.ply", body, body.rest_pose)
    assert rigid.bones.shape[1] == 1
    assert set(rigid.bones[:, 0]) <= {0, 1, 2}
    low = vertices[:, 2] < 0.25
    assert (rigid.bones[low & (vertices[:, 0] > 0.05), 0] == 0).any()
    for arrays, message in (
        ({"weights": weights[1:]}, r"expected \(162, 3\)"),
        ({"weights": 0 * weights}, "a vertex without"),
        ({"weights": weights, "bones": ["a", "b", "c"]}, "no bone 'a' in stick"),
        ({"other": weights}, "lacks weights"),
    ):
        np.savez(tmp_path / "w.npz", **arrays)
        with pytest.raises(InputError, match=rf"w\.npz: .*{message}"):
            load_mesh(tmp_path / "person.ply", body, body.rest_pose, tmp_path / "w.npz")
    with pytest.raises(InputError, match="20 vertices per part"):
        cone_mesh(body, 20)
