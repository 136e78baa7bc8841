"""A voxel cloud per frame, on the host."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import psfs

sequence = psfs.open_sequence("walk")
clouds = list(psfs.reconstruct(sequence, frames=slice(0, None, 12)))
psfs.write_cloud(clouds[0], Path("first"))  # first.ply and first.npz

figure = plt.figure(figsize=(8, 3))
axes = figure.add_axes((0, 0, 1, 1), projection="3d")
for number, cloud in enumerate(clouds):
    x, y, z = cloud.centres.T  # (N,) m each
    axes.scatter(x, y + 0.8 * number, z, c=cloud.colour / 255, s=1, depthshade=False)
span = np.ptp([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()], axis=1)
axes.set_box_aspect(span, zoom=1.8)
axes.view_init(elev=10, azim=-10)
axes.axis("off")
figure.savefig("voxels.png", dpi=90)
