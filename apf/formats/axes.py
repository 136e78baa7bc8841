"""The axes that a TRC or C3D may have, by name."""

#: "y-up": as OpenSim's; "pose2sim": as Pose2Sim writes them; "z-up": those of this program.
AXES = ("y-up", "pose2sim", "z-up")
