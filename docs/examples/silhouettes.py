"""What each pixel says of the person, before any voxel is carved."""

import matplotlib.pyplot as plt

import psfs

sequence = psfs.open_sequence("walk")
session = psfs.Session(sequence, psfs.select_device("auto"))
middle = len(sequence) // 2
[evidence] = session.evidence([middle])  # (cameras, height, width), above 0: the person

figure, axes = plt.subplots(1, 2, figsize=(8, 3.2), layout="constrained")
axes[0].imshow(sequence.read(middle).images[0][..., ::-1])  # BGR to RGB
axes[1].imshow(evidence[0], cmap="RdBu_r", vmin=-127, vmax=127)
for axis, title in zip(axes, ("picture", "evidence for the person"), strict=True):
    axis.set_title(title)
    axis.axis("off")
figure.savefig("silhouettes.png", dpi=90)
