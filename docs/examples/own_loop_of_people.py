"""Several people, frame by frame: one reconstruction, and a search for each of them."""

import numpy as np

import apf
import psfs

device = psfs.select_device("auto")
sequence = psfs.open_sequence("walkers")
truth = apf.load_people_truth("walkers/truth.npz")
bodies, poses = [], []
for joints in truth.values():  # of each person
    first = dict(zip(joints.joint_names, joints.joints[0], strict=True))
    body, pose, _ = apf.fit_to_joints(apf.load_body("song31"), first)
    bodies.append(body)
    poses.append(pose)

places = np.concatenate([joints.joints for joints in truth.values()], axis=1)  # (F, P J, 3) m
low, high = np.nanmin(places, axis=(0, 1)) - 0.3, np.nanmax(places, axis=(0, 1)) + 0.3
grid = psfs.VoxelGrid.covering(low, high, 0.03)

reconstructor = psfs.Reconstructor(device, sequence.rig, grid, sequence.background)
method = apf.Method.create(n_particles=100)
people = apf.PeopleTracker(device, sequence.rig, reconstructor.voxels, bodies, method)
people.start(poses)
for estimates in people.stream(reconstructor.stream(sequence)):  # the device works ahead
    assert all(np.isfinite(estimate.joints).all() for estimate in estimates)  # (J, 3) m
for name, estimate in zip(truth, estimates, strict=True):
    print(f"{name}: misfit of the last frame {estimate.misfit:.2f}")
