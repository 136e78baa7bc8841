"""A body is bones, joints and cones; a pose is one number for each degree of freedom."""

import matplotlib.pyplot as plt
import numpy as np

import apf
from apf.body.kinematics import posed_joints

body = apf.load_body("song31")
pose = body.rest_pose.copy()  # (D,) rad and m
pose[body.dof_names.index("l_upper_arm.rx")] += np.pi / 3
pose[body.dof_names.index("r_thigh.ry")] -= np.pi / 4
pose[body.dof_names.index("r_calf.ry")] += np.pi / 3
joints = posed_joints(body, pose[None])[0]  # (J, 3) m

figure = plt.figure(figsize=(4, 4), layout="constrained")
axes = figure.add_subplot(projection="3d")
for edge in body.edges:
    axes.plot(*joints[list(edge)].T, color="teal", linewidth=3)
axes.set(aspect="equal", title=f"{body.name}: {body.n_dof} degrees of freedom")
axes.view_init(elev=10, azim=-50)
figure.savefig("body.png", dpi=90)
