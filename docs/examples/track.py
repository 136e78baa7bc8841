"""From a folder to a track. The start is known here; without `init` it is found."""

import matplotlib.pyplot as plt
import numpy as np

import apf
import psfs

sequence = psfs.open_sequence("walk")
method = apf.Method.create(n_particles=100, n_layers=6)  # smaller than usual, for a quick look
track = apf.track(sequence, init="walk/truth.npz", method=method)
track.save("track.npz")  # apf.Track.open reads it
apf.smooth_track(track).save("walk.bvh")  # for Blender

figure, axes = plt.subplots(figsize=(8, 3), layout="constrained")
for name in ("l_ankle", "r_ankle", "l_wrist", "r_wrist"):
    joint = track.joints[:, track.joint_names.index(name)]  # (F, 3) m
    axes.plot(np.linalg.norm(joint[:, :2] - joint[0, :2], axis=1), joint[:, 2], label=name)
axes.set(xlabel="way, m", ylabel="height, m")
axes.legend()
figure.savefig("track.png", dpi=90)
