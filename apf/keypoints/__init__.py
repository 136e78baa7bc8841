"""2-D keypoints of any pose network: files, points on the body, triangulation."""

from apf.keypoints.keypoints import Keypoints
from apf.keypoints.landmarks import BodyPoints, Landmark, load_landmarks, locate_points
from apf.keypoints.triangulation import Triangulation, TriangulationConfig, triangulate

__all__ = [
    "BodyPoints",
    "Keypoints",
    "Landmark",
    "Triangulation",
    "TriangulationConfig",
    "load_landmarks",
    "locate_points",
    "triangulate",
]
