"""The body: bones with free axes, their cones and meshes, and forward kinematics."""

from apf.body.cones import cone_distances, overlap_errors, project_outlines
from apf.body.jacobian import distance_jacobian, point_jacobian
from apf.body.kinematics import bone_matrices, posed_cones, posed_joints
from apf.body.limbs import limb_chains, limb_masks, swinging_bones, trunk_mask
from apf.body.mesh import BodyMesh, cone_mesh, load_mesh
from apf.body.model import BodyModel, Bone, Cone, FreeAxis, Joint
from apf.body.toml import load_body, save_body

__all__ = [
    "BodyMesh",
    "BodyModel",
    "Bone",
    "Cone",
    "FreeAxis",
    "Joint",
    "bone_matrices",
    "cone_distances",
    "cone_mesh",
    "distance_jacobian",
    "limb_chains",
    "limb_masks",
    "load_body",
    "load_mesh",
    "overlap_errors",
    "point_jacobian",
    "posed_cones",
    "posed_joints",
    "project_outlines",
    "save_body",
    "swinging_bones",
    "trunk_mask",
]
