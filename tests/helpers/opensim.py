"""A model of OpenSim with the joints that are read."""

from pathlib import Path

#: Joints of a model with the proportions of Rajagopal et al. 2016: the bodies that they connect,
#: and their place in the first, m.
JOINTS = [
    ("pelvis", "torso", (-0.10, 0.08, 0.0)),
    ("torso", "head", (0.0, 0.54, 0.0)),
    *(
        joint
        for side, z in (("l", -1), ("r", 1))
        for joint in (
            ("pelvis", f"femur_{side}", (-0.07, -0.07, 0.083 * z)),
            (f"femur_{side}", f"tibia_{side}", (0.0, -0.41, 0.0)),
            (f"tibia_{side}", f"talus_{side}", (0.0, -0.42, 0.0)),
            (f"talus_{side}", f"calcn_{side}", (-0.05, -0.04, 0.01 * z)),
            ("torso", f"humerus_{side}", (0.0, 0.37, 0.17 * z)),
            (f"humerus_{side}", f"ulna_{side}", (0.01, -0.29, -0.01 * z)),
            (f"ulna_{side}", f"radius_{side}", (-0.01, -0.01, 0.03 * z)),
            (f"radius_{side}", f"hand_{side}", (-0.01, -0.24, 0.01 * z)),
        )
    ),
]


def write_model(path: Path, left_out: str = "") -> Path:
    """Write a generic model of OpenSim as far as it is read; left_out: a body without a joint."""
    joints = "".join(
        f"<CustomJoint name='{far}'><socket_parent_frame>a</socket_parent_frame>"
        "<socket_child_frame>b</socket_child_frame><frames>"
        f"<PhysicalOffsetFrame name='a'><socket_parent>/bodyset/{near}</socket_parent>"
        f"<translation>{' '.join(map(str, place))}</translation></PhysicalOffsetFrame>"
        f"<PhysicalOffsetFrame name='b'><socket_parent>/bodyset/{far}</socket_parent>"
        "<translation>0 0 0</translation></PhysicalOffsetFrame></frames><coordinates>"
        f"<Coordinate name='knee_angle_{far[-1]}'><default_value>9</default_value>"
        "<range>0 .01</range><clamped>true</clamped></Coordinate></coordinates></CustomJoint>"
        for near, far, place in JOINTS
        if far != left_out
    )
    path.write_text(
        "<OpenSimDocument><Model><JointSet><objects>" + joints + "</objects></JointSet></Model>"
        "</OpenSimDocument>"
    )
    return path
