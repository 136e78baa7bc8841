"""BVH and GLB files read by independent readers: bvhio, pygltflib, trimesh, and Blender if
installed."""

from dataclasses import replace
from pathlib import Path

import bvhio
import numpy as np
import pygltflib
import pytest
from helpers import bodies
from helpers.gltf import gltf_nodes, gltf_values
from helpers.striders import strider, track_of_poses
from helpers.tracks import lose
from scipy.spatial.transform import Rotation

from apf.body.kinematics import bone_matrices, posed_cones
from apf.body.toml import load_body
from apf.formats.skeleton import TO_Y_UP, build_skeleton
from apf.tracking.track import Track
from psfs.common.cones import cone_distances

#: Where programs of animation have the joints.
NODES = {
    "pelvis": "Hips", "neck": "Head", "l_shoulder": "LeftArm", "l_elbow": "LeftForeArm",
    "l_wrist": "LeftHand", "l_hip": "LeftUpLeg", "l_knee": "LeftLeg", "l_ankle": "LeftFoot",
    "r_shoulder": "RightArm", "r_elbow": "RightForeArm", "r_wrist": "RightHand",
    "r_hip": "RightUpLeg", "r_knee": "RightLeg", "r_ankle": "RightFoot",
}  # fmt: skip


def wild(name: str, frames: int = 12) -> Track:
    body = load_body(name)
    return track_of_poses(body, bodies.random_poses(body, frames, wild=True))


def in_world(point: object) -> np.ndarray:
    """Convert a position of a file with Y up to the tracker's world."""
    return TO_Y_UP.T @ np.array(list(point))  # type: ignore[call-overload]


@pytest.mark.parametrize("name", ["song31", "rymut31"])
def test_bvhio_rebuilds_joints_and_rotations(tmp_path: Path, name: str) -> None:
    track = wild(name)
    track.save(tmp_path / "a.bvh")
    root = bvhio.readAsHierarchy(str(tmp_path / "a.bvh"))
    assert root.Name == "Hips" and root.getKeyframeRange() == (0, 11)
    turned = TO_Y_UP @ bone_matrices(track.its_body, track.poses)[0]
    first = {}
    for frame in range(12):
        root.loadPose(frame)
        for joint, node in NODES.items():
            (found,) = root.filter(node, isEqual=True)
            place = in_world(found.PositionWorld) / 100
            true = track.joints[frame, track.joint_names.index(joint)]
            assert np.linalg.norm(place - true) < 1e-5, (frame, joint)
            if joint.endswith(("wrist", "ankle")):
                continue  # points of the bone before them
            q = found.RotationWorld
            rotation = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
            bone = next(j.bone for j in track.its_body.joints if j.name == joint)
            rest = first.setdefault(joint, rotation.T @ turned[frame, bone])
            away = Rotation.from_matrix(rotation @ rest @ turned[frame, bone].T).magnitude()
            assert np.degrees(away) < 0.01, (frame, joint)


def test_the_text_of_a_bvh(tmp_path: Path) -> None:
    track = replace(strider(4), frames=np.array([8, 10, 12, 16]))
    track.save(tmp_path / "a.bvh")
    text = (tmp_path / "a.bvh").read_text()
    assert text.count("CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation") == 1
    n_turning = text.count("CHANNELS 3 Zrotation Xrotation Yrotation")
    # Every second frame of 60; the one that is missing holds the pose before it.
    assert f"\nFrames: 5\nFrame Time: {1 / 30:.8f}\n" in text
    rows = np.array([line.split() for line in text.splitlines()[-5:]], float)
    assert rows.shape == (5, 6 + 3 * n_turning)
    np.testing.assert_array_equal(rows[3], rows[2])
    np.testing.assert_allclose(rows[0, :3], [0, 86, 0], atol=1e-4)
    for short in (0, 1):
        for ending in ("bvh", "glb"):
            strider(short).save(tmp_path / f"a.{ending}")
            assert (tmp_path / f"a.{ending}").stat().st_size > 500


def test_bodies_of_any_structure(tmp_path: Path) -> None:
    """A slider after a hinge, a turned bone, two roots, one of them without anything below it."""
    body = bodies.named("stick")
    track = track_of_poses(body, bodies.random_poses(body, 6, wild=True))
    track.save(tmp_path / "a.bvh")
    text = (tmp_path / "a.bvh").read_text()
    assert text.count("ROOT") == 2 and text.count("{") == text.count("}")
    skeleton = build_skeleton(body)
    local, shifts = skeleton.motion(body, track.poses)
    turned, placed = np.empty_like(local), np.empty_like(shifts)
    for index, node in enumerate(skeleton.nodes):
        turned[:, index], placed[:, index] = local[:, index], shifts[:, index]
        if node.parent >= 0:
            turned[:, index] = turned[:, node.parent] @ local[:, index]
            moved = np.einsum("fab,fb->fa", turned[:, node.parent], shifts[:, index])
            placed[:, index] = placed[:, node.parent] + moved
    nodes = list(enumerate(skeleton.nodes))
    for column, joint in enumerate(body.joints):
        at = next(k for k, node in nodes if node.bone == joint.bone)
        if joint.position.any():
            offset = skeleton.rest[joint.bone] @ joint.position
            on_bone = [k for k, node in nodes if node.parent == at and node.bone is None]
            at = next(k for k in on_bone if np.array_equal(skeleton.nodes[k].offset, offset))
        np.testing.assert_allclose(placed[:, at] @ TO_Y_UP, track.joints[:, column], atol=1e-9)


@pytest.mark.parametrize("name", ["song31", "rymut31"])
def test_gltf_rebuilds_joints_and_skin(tmp_path: Path, name: str) -> None:
    track = replace(wild(name), frames=np.arange(30, 42))
    track.save(tmp_path / "a.glb")
    lose(track, [3, 4]).save(tmp_path / "lost.glb")
    about = pygltflib.GLTF2().load(tmp_path / "lost.glb").animations[0].extras
    assert about["lost_frames"] == [33, 34] and "not smoothed" in about["note"]
    file = pygltflib.GLTF2().load(tmp_path / "a.glb")
    names = [node.name for node in file.nodes]
    assert len(set(names)) == len(names)
    times = gltf_values(file, file.animations[0].samplers[0].input)[:, 0]
    np.testing.assert_allclose(times, np.arange(12) / 60, atol=1e-6)
    unbind = gltf_values(file, file.skins[0].inverseBindMatrices).reshape(-1, 4, 4)
    attributes = file.meshes[0].primitives[0].attributes
    points, owners, normals = (
        gltf_values(file, getattr(attributes, kind)) for kind in ("POSITION", "JOINTS_0", "NORMAL")
    )
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    for frame in (0, 5, 11):
        matrices = gltf_nodes(file, frame)
        for joint, node in NODES.items():
            place = in_world(matrices[names.index(node), :3, 3])
            true = track.joints[frame, track.joint_names.index(joint)]
            assert np.linalg.norm(place - true) < 1e-5
        bound = matrices[file.skins[0].joints] @ unbind.transpose(0, 2, 1)
        ones = np.column_stack([points, np.ones(len(points))])
        skin = np.einsum("vab,vb->va", bound[owners[:, 0]], ones)[:, :3] @ TO_Y_UP
        # The skin is the body's: its vertices lie on the surface of the posed cones.
        cones = posed_cones(track.its_body, track.poses[frame : frame + 1])[0]
        assert np.abs(cone_distances(skin, cones)).min(1).max() < 0.02
