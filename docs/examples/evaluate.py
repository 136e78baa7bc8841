"""A track compared with known joints."""

import matplotlib.pyplot as plt
import numpy as np

import apf

found = apf.evaluate(apf.Track.open("track.npz"), apf.load_truth("walk/truth.npz"))
print(f"mean error {1000 * found.mean_error:.0f} mm")

figure, axes = plt.subplots(figsize=(8, 3), layout="constrained")
axes.bar(found.joint_names, 1000 * np.nanmean(found.errors, axis=0), color="teal")
axes.set(ylabel="mean error, mm")
axes.tick_params(axis="x", rotation=60)
figure.savefig("evaluate.png", dpi=90)
