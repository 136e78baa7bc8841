"""Motion file formats by file ending: `WRITERS` need points only, `BODY_WRITERS` need the body."""

#: Axes that a TRC or C3D may have: OpenSim's, those that Pose2Sim writes, this program's.
AXES = ("y-up", "pose2sim", "z-up")
