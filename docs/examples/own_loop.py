"""The parts of `apf.track`, frame by frame: for a program of your own."""

import numpy as np

import apf
import psfs

device = psfs.select_device("auto")
sequence = psfs.open_sequence("walk")
grid = psfs.automatic_grid(psfs.Session(sequence, device))
truth = apf.load_truth("walk/truth.npz")
first = dict(zip(truth.joint_names, truth.joints[0], strict=True))
body, pose, _ = apf.fit_to_joints(apf.load_body("song31"), first)

reconstructor = psfs.Reconstructor(device, sequence.rig, grid, sequence.background)
scene = apf.Scene(device, sequence.rig, grid, body)
tracker = apf.AnnealedParticleFilter(scene, apf.FilterConfig.create(n_particles=100))
tracker.start(pose)
for voxels in reconstructor.stream(sequence):  # they stay on the device
    estimate = tracker.step(voxels)
    assert np.isfinite(estimate.joints).all()  # (J, 3) m
print(f"misfit of the last frame: {estimate.misfit:.2f}")
