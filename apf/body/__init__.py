"""The body: bones with free axes, their cones and meshes, and forward kinematics."""
