"""Clinical joint angles of a track, and how sure each limb is."""

import matplotlib.pyplot as plt

import apf

track = apf.Track.open("track.npz")
smooth = apf.smooth_track(track)

figure, (above, below) = plt.subplots(2, 1, figsize=(8, 4), sharex=True, layout="constrained")
for side in ("l", "r"):
    above.plot(smooth.times, smooth.angles[f"{side}_knee_flexion"], label=f"{side} knee")
above.set(ylabel="flexion, degrees")
above.legend()
below.plot(track.times, track.limb_confidence)  # (F, limbs), 0 to 1
below.set(xlabel="s", ylabel="confidence of limbs", ylim=(0, 1.05))
figure.savefig("angles.png", dpi=90)
