"""2-D keypoints of any pose network: their files, their points on the body, triangulation."""

from apf.keypoints.keypoints import Keypoints
from apf.keypoints.landmarks import BodyPoints, Landmark, load_landmarks, points_on
from apf.keypoints.triangulation import Triangulated, TriangulationConfig, triangulate

__all__ = [
    "BodyPoints",
    "Keypoints",
    "Landmark",
    "Triangulated",
    "TriangulationConfig",
    "load_landmarks",
    "points_on",
    "triangulate",
]
