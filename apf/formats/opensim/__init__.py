"""Motion for OpenSim: a public model scaled to the body, and its inverse kinematics."""
